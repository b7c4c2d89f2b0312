"""A whole simulation on two threads: wall time and peak memory of this process, which does nothing else."""

from __future__ import annotations

import resource
import statistics
import sys
import time

from scenes import APERTURE, CHIRP, bumpy_ellipsoid, measure, report

from waveformer.simulator import Target, simulate

RUNS = 7


def main(quick: bool) -> None:
    target = Target(bumpy_ellipsoid())
    started = time.perf_counter()
    simulate(target, CHIRP, APERTURE)
    first_s = time.perf_counter() - started
    # ru_maxrss counts kilobytes on Linux
    peak_bytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    timing = measure(lambda: simulate(target, CHIRP, APERTURE), 5 if quick else RUNS)
    report(
        [
            {
                "name": "mesh to raw signal",
                "runs": len(timing.wall_s),
                "wall_s": statistics.median(timing.wall_s),
                "lowest_wall_s": min(timing.wall_s),
                "highest_wall_s": max(timing.wall_s),
                "cpu_s": statistics.median(timing.cpu_s),
                "first_run_wall_s": first_s,
                "peak_bytes": peak_bytes,
            }
        ]
    )


if __name__ == "__main__":
    main("--quick" in sys.argv)
