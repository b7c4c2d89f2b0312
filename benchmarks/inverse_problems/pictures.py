"""The pictures of docs/inverse_problems.md, from the rows that the other programs print."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

COLOURS = {"power drill": "tab:blue", "mug": "tab:orange", "clamp": "tab:green"}


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a file with one JSON object a line."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def matter(rows: list[dict[str, Any]], path: Path) -> None:
    """Starts, results and truth in the plane of permittivity and roughness."""
    figure, axes = plt.subplots(figsize=(5.5, 4), constrained_layout=True)
    for row in rows:
        colour = COLOURS[row["object"]]
        found = (
            row["permittivity"] * (1 + row["permittivity_error"]),
            row["roughness_m"] * (1 + row["roughness_error"]),
        )
        axes.plot(
            [row["start"][0], found[0]],
            [1e6 * row["start"][1], 1e6 * found[1]],
            color=colour,
            lw=0.5,
            alpha=0.6,
        )
        axes.plot(row["start"][0], 1e6 * row["start"][1], "o", ms=3, mfc="none", color=colour)
        axes.plot(found[0], 1e6 * found[1], ".", color=colour)
    for name in dict.fromkeys(row["object"] for row in rows):
        row = next(row for row in rows if row["object"] == name)
        axes.plot(row["permittivity"], 1e6 * row["roughness_m"], "k+", ms=12)
        axes.annotate(
            name, (row["permittivity"], 1e6 * row["roughness_m"]), xytext=(6, 6), textcoords="offset points"
        )
    axes.set(
        xlabel="relative permittivity",
        ylabel="rms roughness in micrometres",
        title="Circles: starts, dots: found, crosses: truth",
    )
    figure.savefig(path, dpi=120)


def radar(rows: list[dict[str, Any]], path: Path) -> None:
    """Row depths of one radar, true and found, and their difference."""
    row = next(row for row in rows if "rows_true_m" in row)
    true, found = 1e6 * np.array(row["rows_true_m"]), 1e6 * np.array(row["rows_found_m"])
    figure, (upper, lower) = plt.subplots(
        2, 1, sharex=True, figsize=(6, 4), height_ratios=(2, 1), constrained_layout=True
    )
    upper.step(range(len(true)), true, where="mid", color="k", label="true")
    upper.plot(found, "o", mfc="none", color=COLOURS[row["object"]], label=f"found with the {row['object']}")
    upper.set(ylabel="depth of the row\nin micrometres")
    upper.legend()
    lower.bar(range(len(true)), found - true, color=COLOURS[row["object"]])
    lower.set(xlabel="raster row", ylabel="found less true\nin micrometres")
    figure.savefig(path, dpi=120)


def joint(rows: list[dict[str, Any]], path: Path) -> None:
    """Misfit over the steps of all starts."""
    figure, axes = plt.subplots(figsize=(6, 3.5), constrained_layout=True)
    for row in rows:
        first = row is next(other for other in rows if other["object"] == row["object"])
        axes.semilogy(
            row["history"], ".-", lw=0.8, color=COLOURS[row["object"]], label=row["object"] if first else None
        )
    axes.set(xlabel="accepted step, all three stages", ylabel="misfit (residual power over signal power)")
    axes.legend()
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    folder, images = Path(sys.argv[1]), Path(sys.argv[2])
    images.mkdir(parents=True, exist_ok=True)
    for draw in (matter, radar, joint):
        source = folder / f"{draw.__name__}.jsonl"
        if source.exists():
            draw(read(source), images / f"inverse_{draw.__name__}.png")
