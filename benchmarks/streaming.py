"""A scan as large as MITO's simulated ones, written to disk by worker processes: wall time and memory."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from pathlib import Path

from scenes import bumpy_ellipsoid, report

from waveformer.simulator import Aperture, Chirp, simulate_to_store


def resident_bytes(root: int) -> int:
    """Memory of a process and its children that no other process shares, from /proc; 0 where there is none."""
    total, pending = 0, [root]
    while pending:
        process = pending.pop()
        try:
            rollup = Path(f"/proc/{process}/smaps_rollup").read_text()
            total += 1024 * sum(
                int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:")
            )
            for task in Path(f"/proc/{process}/task").iterdir():
                pending += [int(child) for child in (task / "children").read_text().split()]
        except (OSError, ValueError):
            continue
    return total


def main(quick: bool) -> None:
    aperture = Aperture.from_preset("mito" if quick else "mito_quarter_wave")
    highest, running = 0, True

    def watch() -> None:
        nonlocal highest
        while running:
            highest = max(highest, resident_bytes(os.getpid()))
            time.sleep(0.2)

    watcher = threading.Thread(target=watch)
    watcher.start()
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        simulate_to_store(bumpy_ellipsoid(), Chirp.from_preset("mito"), aperture, Path(folder) / "scan.zarr")
        wall_s = time.perf_counter() - started
        size = sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file())
    running = False
    watcher.join()
    report(
        [
            {
                "name": f"{len(aperture):,} positions x 512 samples to disk",
                "stream_wall_s": wall_s,
                "positions_per_s": len(aperture) / wall_s,
                "stream_peak_bytes": highest,
                "stored_bytes": size,
            }
        ]
    )


if __name__ == "__main__":
    main("--quick" in sys.argv)
