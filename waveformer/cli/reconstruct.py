"""`waveformer reconstruct`: a scan in, the point cloud of the surface that reflected out."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from waveformer.cli.report import print_notes, print_result, progress
from waveformer.simulator.errors import RadarError

if TYPE_CHECKING:
    from waveformer.model.imaging_volume import Volume
    from waveformer.simulator.measurement import Measurement

Corner = tuple[float, float, float]
_METHODS = ("proposal", "mmnorm", "backprojection")


def reconstruct(
    scan: Annotated[Path, typer.Argument(help="Any saved scan (Zarr).")],
    out: Annotated[Path, typer.Option(help="Cloud to write, metres.", metavar="CLOUD.ply")],
    method: Annotated[
        str,
        typer.Option(
            help="proposal (normals, levels, and the one whose echoes fit), mmnorm (fitted by magnitudes alone, as "
            "mmNorm does) or backprojection (bright voxels)."
        ),
    ] = "proposal",
    spacing: Annotated[float, typer.Option(help="Voxel edge, metres.")] = 0.003,
    min_m: Annotated[
        Corner | None,
        typer.Option("--min", metavar="X Y Z", help="Lowest corner of the imaged box, metres. [looked for]"),
    ] = None,
    max_m: Annotated[
        Corner | None,
        typer.Option("--max", metavar="X Y Z", help="Highest corner of the imaged box, metres. [looked for]"),
    ] = None,
    field: Annotated[
        str, typer.Option(help="Integration of the normals: breadth_first (the paper's) or least_squares.")
    ] = "breadth_first",
    choice: Annotated[
        str, typer.Option(help="argmin of the loss, or with mmnorm also last_peak, as mmNorm chooses.")
    ] = "argmin",
    antennas: Annotated[int, typer.Option(help="Antennas whose echoes are compared.", min=1)] = 200,
    share: Annotated[
        float, typer.Option(help="Backprojection: least |S| of a voxel, as a share of the largest.")
    ] = 0.4,
    png: Annotated[
        bool, typer.Option("--png", help="Also draw image, normals, levels and the chosen surface.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the drawn antennas and background samples.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing cloud.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Reconstruct the surface that a scan shows."""
    from waveformer.eval.baselines import backprojection_cloud
    from waveformer.model.proposal import propose_surfaces
    from waveformer.simulator.front_end_streams import generator
    from waveformer.simulator.measurement import Measurement
    from waveformer.simulator.storage import check_file_writable, publish_file

    if method not in _METHODS:
        raise RadarError(f"unknown method {method!r}; known: {', '.join(_METHODS)}")
    if out.suffix.lower() != ".ply":
        raise RadarError(f"{out}: the cloud is written as PLY, name it {out.with_suffix('.ply').name}")
    picture = out.with_suffix(".png")
    check_file_writable(out, force)
    if png:
        check_file_writable(picture, force)
    if choice == "last_peak" and method != "mmnorm":
        raise RadarError("--choice last_peak is a rule of mmNorm: add --method mmnorm")
    loss = "magnitude" if method == "mmnorm" else "complex"
    settings = _settings(spacing, field, {"choice": choice, "num_antennas": antennas, "loss": loss})
    measurement = Measurement.load(scan)
    started = time.perf_counter()
    with progress("imaging") as report:
        proposal = propose_surfaces(
            measurement, settings, crop=_crop(measurement, min_m, max_m),
            rng=generator(seed, "reconstruct"), progress=report,
        )  # fmt: skip
    if method == "backprojection" and proposal.focus is not None:
        points_m = backprojection_cloud(proposal.focus.image, proposal.focus.grid, share)
    else:
        points_m = proposal.surface_m()
    seconds = time.perf_counter() - started
    print_notes(proposal.warnings)
    if len(points_m) == 0:
        raise RadarError(f"{scan}: no surface found: {proposal.reason}")
    _write_cloud(out, points_m, force)
    if png:
        from waveformer.eval.proposal_figure import proposal_figure

        with publish_file(picture, overwrite=force) as temporary:
            proposal_figure(proposal, None, temporary, title=str(scan))
    summary: dict[str, Any] = {
        "out": str(out),
        "png": str(picture) if png else None,
        "method": method,
        "points": len(points_m),
        "components": len(proposal.fields),
        "chosen_m": list(proposal.chosen_m),
        "column_ratio": proposal.column_ratio() if proposal.fields else None,
        "uncertain": proposal.uncertain,
        "confidence": None if method == "backprojection" else round(proposal.confidence(measurement), 3),
        "seconds": round(seconds, 3),
        "warnings": list(proposal.warnings),
    }
    text = f"{out}: {len(points_m)} points in {seconds:.1f} s"
    if summary["confidence"] is not None:
        text += f", confidence {summary['confidence']:.2f}"
    print_result(summary, text + (f"; {picture}" if png else ""), json_output)


def _settings(spacing: float, field: str, selection: dict[str, Any]) -> Any:
    from pydantic import ValidationError

    from waveformer.model.proposal import ProposalSettings

    try:
        return ProposalSettings.model_validate({"spacing_m": spacing, "field": field, "selection": selection})
    except ValidationError as error:
        first = error.errors()[0]
        raise RadarError(
            f"{'.'.join(map(str, first['loc']))}: {first['msg']}, got {first['input']!r}"
        ) from None


def _crop(measurement: Measurement, min_m: Corner | None, max_m: Corner | None) -> Volume | None:
    """The box asked for; None to look for it."""
    import numpy as np

    from waveformer.model.imaging_volume import Volume

    if (min_m is None) != (max_m is None):
        raise RadarError("give both --min X Y Z and --max X Y Z, or neither")
    if min_m is None or max_m is None:
        return None
    low, high = np.array(min_m), np.array(max_m)
    if not (np.isfinite([low, high]).all() and (low < high).all()):
        raise RadarError(f"--min must lie below --max along every axis, got {min_m} and {max_m}")
    return Volume(low, high)


def _write_cloud(path: Path, points_m: Any, force: bool) -> None:
    import trimesh

    from waveformer.simulator.storage import publish_file

    data = trimesh.PointCloud(points_m).export(file_type="ply")
    with publish_file(path, overwrite=force) as temporary:
        temporary.write_bytes(data)
