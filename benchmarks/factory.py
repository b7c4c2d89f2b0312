"""The factory: samples an hour, with one and two workers, memory of all processes, and bytes of a sample.

python factory.py CATALOG FOLDER [--objects N]        (a row a run on stdout, JSON)
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import psutil

from waveformer.datagen.dataset_reader import open_dataset

_POLL_S = 5.0  # asking for memory stops a process for milliseconds


def run(command: list[str]) -> tuple[dict[str, Any], float, int]:
    """Summary, wall time and peak memory (unique set of all processes) of a waveformer command."""
    process = subprocess.Popen(
        [sys.executable, "-m", "waveformer", *command, "--json"], stdout=subprocess.PIPE, text=True
    )
    peak = 0

    def watch() -> None:
        nonlocal peak
        while process.poll() is None:
            total = 0
            try:
                root = psutil.Process(process.pid)
                for item in [root, *root.children(recursive=True)]:
                    try:
                        total += item.memory_full_info().uss
                    except psutil.Error:
                        continue
            except psutil.Error:
                return
            peak = max(peak, total)
            time.sleep(_POLL_S)

    watcher = threading.Thread(target=watch, daemon=True)
    started = time.perf_counter()
    watcher.start()
    assert process.stdout is not None
    summary = json.loads(process.stdout.read())
    process.wait()
    seconds = time.perf_counter() - started
    watcher.join()
    return summary, seconds, peak


def bytes_per_sample(store: Path) -> dict[str, float]:
    """Bytes on disk of every array, per committed sample."""
    data = open_dataset(store)
    return {
        name: sum(
            path.stat().st_size for path in (store / "samples.zarr" / name / "c").rglob("*") if path.is_file()
        )
        / max(len(data), 1)
        for name in data.arrays
    }


def main(catalog: Path, folder: Path, objects: int, workers: list[int], names: list[str]) -> None:
    runs = {
        "partials": ["generate", "--catalog", str(catalog), "--limit", str(objects), "--partials-only"],
        "signals": ["generate", "--catalog", str(catalog), "--limit", str(objects), "--signals"],
        "propose": ["propose", str(folder / "signals-2")],
    }
    for name in names:
        command = runs[name]
        for count in workers:
            store = folder / f"{name}-{count}"
            shutil.rmtree(store, ignore_errors=True)
            summary, seconds, peak = run([*command, "--workers", str(count), "--out", str(store)])
            row = {
                "name": name,
                "workers": count,
                "seconds": seconds,
                "peak_bytes": peak,
                **{
                    key: summary[key] for key in ("requested", "committed", "quarantined", "samples_per_hour")
                },
                "bytes_per_sample": bytes_per_sample(store),
            }
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("catalog", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--objects", type=int, default=40)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--runs", nargs="+", default=["partials", "signals", "propose"])
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    main(given.catalog, given.folder, given.objects, given.workers, given.runs)
