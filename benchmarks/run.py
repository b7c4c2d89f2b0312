"""Speed and memory of waveformer on this machine, each benchmark in a process of its own.

What the numbers mean: README.md. Nothing heavy is imported here: a child's peak memory starts from its
parent's.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
DOCUMENT = HERE.parent / "docs" / "benchmarks.md"
START, END = "<!-- results -->", "<!-- results end -->"

# (program, threads of the ray tracer, threads of BLAS): one each where a rate per core is measured
PROGRAMS = (
    ("end_to_end", 2, 2),
    ("end_to_end", 2, 1),
    ("forward_kernel", 1, 1),
    ("imaging_kernel", 1, 1),
    ("imaging_at_scale", 2, 1),
    ("differentiable", 1, 1),
    ("exact_mode", 1, 1),
    ("real_scenes", 2, 1),
    ("streaming", 2, 1),
)
RATE_TARGETS = {"forward kernel": 180e6, "imaging": 230e6, "forward and adjoint": 75e6}
RATIO_TARGETS = {"forward_kernel": 15, "imaging_kernel": 20}
WALL_TARGET_S, MEMORY_TARGET_BYTES = 2.0, 0.5e9
MEMORY_GROWTH_TARGET = 1.5
NORMALS_TARGET, CHAIN_TARGET_S = 0.25, 2.5
FASTER_TARGETS = {"twin's scan, 3 mm": 4, "MITO's density, 1 mm": 15}
STREAM_WALL_TARGET_S, STREAM_MEMORY_TARGET_BYTES = 90.0, 2e9


def run_program(name: str, threads: int, blas_threads: int, quick: bool) -> list[dict[str, Any]]:
    """Rows of one benchmark."""
    settings = {"WAVEFORMER_THREADS": str(threads)}
    settings |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), str(blas_threads))
    load = os.getloadavg()[0]
    done = subprocess.run(
        [sys.executable, str(HERE / f"{name}.py"), *(["--quick"] if quick else [])],
        env={**os.environ, **settings},
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{name} failed with exit code {done.returncode}")
    rows = json.loads(done.stdout.splitlines()[-1])
    conditions = {"threads": threads, "blas_threads": blas_threads, "load_average_before": load}
    return [{"benchmark": name, **conditions, **row} for row in rows]


def machine() -> str:
    """The kind of processor, without its name."""
    text = platform.machine().replace("_", "-")
    if Path("/proc/cpuinfo").exists():
        info = Path("/proc/cpuinfo").read_text()
        text += " with AVX-512" if "avx512f" in info else " with AVX2" if "avx2" in info else ""
        if clock := re.search(r"cpu MHz\s*:\s*([\d.]+)", info):
            text += f", {float(clock[1]) / 1000:.1f} GHz"
    return f"{text}, {os.cpu_count()} cores"


def rate_line(row: dict[str, Any]) -> str:
    """A line of the table of rates."""
    name, benchmark = row["name"], row["benchmark"]
    low, high = row["lowest_per_cpu_s"] / 1e6, row["highest_per_cpu_s"] / 1e6
    digits = 0 if row["pairs_per_cpu_s"] > 20e6 else 2
    slower, error = row.get("slower_than_kernel"), row.get("relative_l2_error")
    target = ""
    if name in RATE_TARGETS:
        target = f"≥ {RATE_TARGETS[name] / 1e6:.0f} M/s"
    elif slower is not None and benchmark in RATIO_TARGETS:
        target = f"≥ {RATIO_TARGETS[benchmark]} ×"
    cells = [
        name,
        f"{row['pairs_per_cpu_s'] / 1e6:.{digits}f} ({low:.{digits}f} – {high:.{digits}f})",
        f"{row['pairs_per_wall_s'] / 1e6:.{digits}f}",
        "" if slower is None else f"{slower:.1f} ×",
        target,
        "" if error is None else "reference" if error == 0 else f"{error:.1e}",
    ]
    return "| " + " | ".join(cells) + " |"


def whole_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of whole simulations, a column for each choice of threads."""
    quantities = (
        ("wall time, median", "wall_s", "s", 1.0, f"≤ {WALL_TARGET_S:g} s"),
        ("wall time, lowest", "lowest_wall_s", "s", 1.0, ""),
        ("wall time, highest", "highest_wall_s", "s", 1.0, ""),
        ("processor time of both threads, median", "cpu_s", "s", 1.0, ""),
        ("wall time of the first run in a process", "first_run_wall_s", "s", 1.0, ""),
        ("peak memory of that process", "peak_bytes", "GB", 1e-9, f"≤ {MEMORY_TARGET_BYTES / 1e9:g} GB"),
        ("load average before", "load_average_before", "", 1.0, ""),
    )
    columns = [f"{row['threads']} threads, BLAS {row['blas_threads']}" for row in rows]
    lines = [f"| whole simulation | {' | '.join(columns)} | target |", "|---" * (len(rows) + 2) + "|"]
    for label, key, unit, scale, target in quantities:
        cells = [label, *(f"{row[key] * scale:.2f} {unit}".strip() for row in rows), target]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def scene_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of scenes with matter in them."""
    lines = [
        "| whole simulation, 2 threads | wall time | processor time | over the conductor |",
        "|---|---|---|---|",
    ]
    for row in rows:
        cells = [row["name"], f"{row['scene_wall_s']:.1f} s", f"{row['scene_cpu_s']:.1f} s"]
        lines.append("| " + " | ".join([*cells, f"{row['over_conductor']:.1f} ×"]) + " |")
    return lines


def stream_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of scans written to disk."""
    lines = [
        "| streamed by 2 worker processes | wall time | positions per second | peak memory, all processes |",
        "|---|---|---|---|",
    ]
    for row in rows:
        wall = f"{row['stream_wall_s']:.0f} s (target ≤ {STREAM_WALL_TARGET_S:.0f} s)"
        memory = (
            f"{row['stream_peak_bytes'] / 1e9:.2f} GB (target ≤ {STREAM_MEMORY_TARGET_BYTES / 1e9:.0f} GB)"
        )
        lines.append(f"| {row['name']} | {wall} | {row['positions_per_s']:,.0f} | {memory} |")
    return lines


def memory_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of peak memory over the number of pairs, forward and backward."""
    lines = [
        "| forward and backward pass in torch | peak memory of the process | over the smallest |",
        "|---|---|---|",
    ]
    for row in rows:
        pairs, peak = row["memory_pairs"], row["memory_bytes"]
        share = f"{peak / rows[0]['memory_bytes']:.2f} × (target ≤ {MEMORY_GROWTH_TARGET:g} ×)"
        lines.append(f"| {pairs / 1e6:,.0f} · 10⁶ pairs | {peak / 1e9:.2f} GB | {share} |")
    return lines


def imaging_table(rows: list[dict[str, Any]]) -> list[str]:
    """The table of images at scale, merged and direct."""
    heading = (
        "| image and normals, 2 threads | voxels x channels | wall time | 10⁶ pairs per CPU second, image alone | "
        "direct sum | faster by | normals add | largest error above 0.2 of the maximum |"
    )
    lines = [heading, "|---|---|---|---|---|---|---|---|"]
    for row in rows:
        faster = f"{row['faster_than_direct']:.1f} × (target ≥ {FASTER_TARGETS[row['name']]} ×)"
        add = f"{100 * row['normals_add']:.0f} % (target ≤ {100 * NORMALS_TARGET:.0f} %)"
        cells = [
            row["name"],
            f"{row['voxels']:,} x {row['channels']:,}",
            f"{row['image_wall_s']:.1f} s",
            f"{row['focus_per_cpu_s'] / 1e6:,.0f}",
            f"{row['direct_per_cpu_s'] / 1e6:,.0f}",
            faster,
            add,
            f"{100 * row['largest_error']:.1f} % (target ≤ 2 %)",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def chain_table(rows: list[dict[str, Any]]) -> list[str]:
    """The time from a signal to candidate surfaces."""
    lines = ["| 7,676 antennas, 3 mm, 2 threads | wall time, median |", "|---|---|"]
    for row in rows:
        lines.append(f"| {row['name']} | {row['chain_wall_s']:.1f} s (target ≤ {CHAIN_TARGET_S:g} s) |")
    return lines


def markdown(result: dict[str, Any]) -> str:
    """The results as tables."""
    rows = result["rows"]
    before, after = result["load_average"]
    lines = [f"{result['machine']}; load average {before:.1f} before, {after:.1f} after."]
    if result["quick"]:
        lines.append("Short form (`--quick`).")
    rates = [rate_line(row) for row in rows if "pairs_per_cpu_s" in row]
    heading = (
        "| one thread | 10⁶ pairs per CPU second (range) | per second | kernel faster by | target | error |"
    )
    if rates:
        lines += ["", heading, "|---|---|---|---|---|---|", *rates]
    whole = [row for row in rows if "wall_s" in row]
    if whole:
        lines += ["", *whole_table(whole)]
    for key, table in (
        ("faster_than_direct", imaging_table),
        ("chain_wall_s", chain_table),
        ("scene_wall_s", scene_table),
        ("stream_wall_s", stream_table),
        ("memory_bytes", memory_table),
    ):
        if chosen := [row for row in rows if key in row]:
            lines += ["", *table(chosen)]
    return "\n".join(lines)


def write_into(document: Path, text: str) -> None:
    """Replace what stands between the markers."""
    before, rest = document.read_text(encoding="utf-8").split(START)
    after = rest.split(END)[1]
    document.write_text(f"{before}{START}\n{text}\n{END}{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer runs on smaller parts, about two minutes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the numbers there")
    parser.add_argument(
        "--markdown",
        type=Path,
        nargs="?",
        const=DOCUMENT,
        metavar="FILE",
        help="also put the tables between the markers of this file [docs/benchmarks.md]",
    )
    parser.add_argument("--only", choices=sorted({program[0] for program in PROGRAMS}), help="one benchmark")
    arguments = parser.parse_args()
    before = os.getloadavg()[0]
    rows: list[dict[str, Any]] = []
    for program in PROGRAMS:
        if arguments.only in (None, program[0]):
            started = time.perf_counter()
            rows += run_program(*program, arguments.quick)
            print(f"{program[0]}: {time.perf_counter() - started:.0f} s", file=sys.stderr)
    result = {
        "machine": machine(),
        "quick": arguments.quick,
        "load_average": [before, os.getloadavg()[0]],
        "rows": rows,
    }
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(markdown(result))
    if arguments.markdown:
        write_into(arguments.markdown, markdown(result))


if __name__ == "__main__":
    main()
