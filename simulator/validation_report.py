"""Validation results as a table, as JSON and as a figure."""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from waveformer.simulator.validation_result import CheckResult

JSON_SCHEMA = 1
HEADINGS = (
    "case",
    "mode",
    "quantity",
    "measured",
    "tolerance",
    "",
    "reference",
    "where the tolerance comes from",
)
_PACKAGES = ("numpy", "scipy", "mitsuba", "drjit", "torch", "trimesh")
# Colours that stay apart for colour-blind readers (Okabe & Ito)
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_MARKERS = {"fast": "o", "exact": "x"}


def table_rows(results: Sequence[CheckResult]) -> list[tuple[str, ...]]:
    """Cells under `HEADINGS`, one row per result, as plain text."""
    return [
        (
            r.name, r.mode or "-", r.quantity, f"{r.measured:.3g} {r.unit}", f"{r.tolerance:g} {r.unit}",
            "pass" if r.passed else "FAIL", r.reference, r.tolerance_source,
        )
        for r in results
    ]  # fmt: skip


def markdown_table(results: Sequence[CheckResult]) -> str:
    """The table in Markdown, for documentation and issue reports."""
    lines = [HEADINGS, tuple("---" for _ in HEADINGS), *table_rows(results)]
    return (
        "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
        + "\n"
    )


def summary(results: Sequence[CheckResult]) -> str:
    """One line: how many passed, and how long it took."""
    failed = sum(not r.passed for r in results)
    seconds = sum(r.seconds for r in results)
    verdict = "all passed" if not failed else f"{failed} FAILED"
    return f"{len(results)} checks, {verdict}, {seconds:.0f} s"


def to_json(results: Sequence[CheckResult], **settings: Any) -> dict[str, Any]:
    """Everything about a run, ready for `json.dumps(..., allow_nan=False)`.

    Args:
        results: of the run.
        **settings: how it was asked for (quick, modes, seed), stored as given.
    """
    from waveformer import __version__

    return {
        "schema": JSON_SCHEMA,
        "waveformer": __version__,
        "environment": {"python": platform.python_version(), "machine": platform.machine()}
        | {name: _installed(name) for name in _PACKAGES},
        "settings": _plain(settings),
        "passed": all(r.passed for r in results),
        "num_failed": sum(not r.passed for r in results),
        "seconds": _plain(sum(r.seconds for r in results)),
        "results": [
            {
                "name": r.name, "mode": r.mode, "quantity": r.quantity, "measured": _plain(r.measured),
                "tolerance": r.tolerance, "unit": r.unit, "passed": r.passed, "reference": r.reference,
                "tolerance_source": r.tolerance_source, "seconds": _plain(r.seconds), "detail": _plain(r.detail),
            }
            for r in results
        ],
    }  # fmt: skip


def plot_validation(results: Sequence[CheckResult], path: Path | str) -> Path:
    """One figure: curves of the bodies on their references, and every check's share of its tolerance.

    Args:
        results: of `run_validation`; a panel without its check stays empty.
        path: image file; the suffix decides the format.
    """
    from matplotlib.figure import Figure  # pyplot would choose a window system

    figure = Figure(figsize=(15, 9), layout="constrained")
    axes = figure.subplots(2, 3).ravel()
    drawers: list[Callable[[Any, list[CheckResult]], None]] = [
        _draw_spheres, _draw_discs, _draw_pattern, _draw_cylinder, _draw_edge,
    ]  # fmt: skip
    for axis, draw, kind in zip(
        axes, drawers, ("sphere", "disc", "pattern", "cylinder", "edge"), strict=False
    ):
        found = [r for r in results if r.detail.get("kind") == kind]
        if found:
            draw(axis, found)
            axis.legend(fontsize=8)
        axis.grid(alpha=0.3)
    _draw_margins(axes[5], results)
    figure.suptitle(f"Simulator against theory: {summary(results)}")
    figure.savefig(path, dpi=120)
    return Path(path)


def _draw_spheres(axis: Any, found: list[CheckResult]) -> None:
    shown = [r for r in found if r.mode == found[0].mode]
    for colour, r in zip(_COLOURS, shown, strict=False):
        ghz, d = np.asarray(r.detail["frequency_hz"]) / 1e9, r.detail
        label = f"a = {100 * d['radius_m']:g} cm, at most {r.measured:.2f} of {r.tolerance:g} dB"
        axis.fill_between(ghz, d["level_db_low"], d["level_db_high"], color=colour, alpha=0.35, label=label)
    axis.set(
        title=f"Spheres against the exact series ({shown[0].mode})",
        xlabel="frequency, GHz",
        ylabel="error, dB",
    )


def _draw_discs(axis: Any, found: list[CheckResult]) -> None:
    drawn: set[float] = set()
    for colour, r in zip(_COLOURS * 2, found, strict=False):
        d = r.detail
        if d["radius_m"] not in drawn:
            axis.plot(100 * d["reference_x"], d["reference_ratio"], color="black", lw=0.8)
            drawn.add(d["radius_m"])
        label = f"a = {100 * d['radius_m']:g} cm, {r.mode}"
        axis.plot(
            100 * d["x"],
            d["measured_ratio"],
            _MARKERS.get(r.mode, "."),
            color=colour,
            ms=3,
            label=label,
        )
    axis.set(title="Discs on their axis; line: exact integral", xlabel="distance, cm", ylabel="|h| / mirror")


def _draw_pattern(axis: Any, found: list[CheckResult]) -> None:
    _draw_on_reference(axis, found, 1.0)
    axis.set(title="5 cm plate at 20 m", xlabel="angle off the normal, deg", ylabel="level, dB of the peak")
    axis.set_ylim(bottom=-60)


def _draw_cylinder(axis: Any, found: list[CheckResult]) -> None:
    _draw_on_reference(axis, found, 100.0)
    axis.axhline(found[0].detail["closed_form_db"], color="grey", ls=":", label="closed form at broadside")
    axis.set(title="Cylinder from its side", xlabel="antenna along the axis, cm", ylabel="|h|, dB")


def _draw_edge(axis: Any, found: list[CheckResult]) -> None:
    _draw_on_reference(axis, found, 100.0)
    axis.axvline(0, color="grey", lw=0.8)
    axis.set(
        title="Foot point across a plate's edge",
        xlabel="beyond the edge, cm",
        ylabel="level, dB of the mirror",
    )


def _draw_on_reference(axis: Any, found: list[CheckResult], scale: float) -> None:
    d = found[0].detail
    axis.plot(
        scale * np.asarray(d["reference_x"]), d["reference_db"], color="black", lw=0.8, label="reference"
    )
    for colour, r in zip(_COLOURS, found, strict=False):
        marker, x = _MARKERS.get(r.mode, "."), scale * np.asarray(r.detail["x"])
        axis.plot(x, r.detail["measured_db"], marker, color=colour, ms=3, label=r.mode)


def _draw_margins(axis: Any, results: Sequence[CheckResult]) -> None:
    share = [r.measured / r.tolerance if np.isfinite(r.measured) else np.inf for r in results]
    height = np.minimum(share, 2.0)
    axis.barh(range(len(share)), height, color=[_COLOURS[0] if r.passed else _COLOURS[1] for r in results])
    axis.axvline(1.0, color="black", lw=0.8)
    axis.set_yticks(range(len(results)), [f"{r.name[:38]} {r.mode} [{r.unit}]" for r in results], fontsize=5)
    axis.invert_yaxis()
    axis.set(title="Error as a share of the tolerance", xlabel="measured / tolerance (cut at 2)")


def _installed(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _plain(value: Any) -> Any:
    """Arrays as lists, six digits, None for what JSON cannot hold."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value
