"""`waveformer image`: raw signal in, voxel image out."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from waveformer import __version__
from waveformer.cli.report import print_notes, print_result, progress
from waveformer.simulator.errors import RadarError

if TYPE_CHECKING:
    from waveformer.simulator.grid import Grid
    from waveformer.simulator.image import Image
    from waveformer.simulator.measurement import Measurement

Corner = tuple[float, float, float]
_MARGIN_M = 0.03


def image(
    scan: Annotated[Path, typer.Argument(help="Scan written by `waveformer simulate`.")],
    out: Annotated[Path, typer.Option(help="Image to write, a Zarr v3 store.", metavar="IMAGE.zarr")],
    spacing: Annotated[float, typer.Option(help="Voxel pitch, metres.")] = 0.003,
    min_m: Annotated[
        Corner | None,
        typer.Option(
            "--min",
            metavar="X Y Z",
            help="Lowest corner of the image, metres. [that of the targets, less 3 cm]",
        ),
    ] = None,
    max_m: Annotated[
        Corner | None,
        typer.Option(
            "--max",
            metavar="X Y Z",
            help="Highest corner of the image, metres. [that of the targets, plus 3 cm]",
        ),
    ] = None,
    png: Annotated[
        bool, typer.Option("--png", help="Also draw its projections as a PNG file beside the image.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Recorded; imaging draws nothing at random.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing image.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Form the backprojection image of a scan."""
    from waveformer.simulator.image import IMAGE_FORMAT
    from waveformer.simulator.measurement import Measurement
    from waveformer.simulator.storage import check_file_writable, check_writable, publish_file

    picture = out.with_suffix(".png")
    check_writable(out, force, IMAGE_FORMAT)
    if png:
        check_file_writable(picture, force)
    measurement = Measurement.load(scan)
    grid = image_grid(measurement, spacing, min_m, max_m)
    started = time.perf_counter()
    formed = form_image(measurement, grid, seed)
    seconds = time.perf_counter() - started
    formed.save(out, overwrite=force)
    notes: list[str] = []
    if png:
        from waveformer.cli.overlay import recorded_box, recorded_meshes
        from waveformer.eval.figures import image_figure

        meshes, notes = recorded_meshes(measurement.metadata)
        with publish_file(picture, overwrite=force) as temporary:
            image_figure(
                formed,
                temporary,
                meshes=meshes,
                aperture=measurement.aperture,
                box_m=recorded_box(measurement.metadata),
            )
    print_notes(notes)
    peak_m = formed.peak_position_m.tolist()
    summary = {
        "out": str(out),
        "png": str(picture) if png else None,
        "voxels": list(grid.shape),
        "spacing_m": spacing,
        "seconds": round(seconds, 3),
        "peak_m": peak_m,
        "notes": notes,
    }
    place = ", ".join(f"{value:.3f}" for value in peak_m)
    size = " x ".join(map(str, grid.shape))
    text = f"{out}: {size} voxels of {spacing * 1e3:g} mm in {seconds:.1f} s; peak at ({place}) m"
    print_result(summary, text + (f"; {picture}" if png else ""), json_output)


def image_grid(
    measurement: Measurement, spacing_m: float, min_m: Corner | None = None, max_m: Corner | None = None
) -> Grid:
    """The grid asked for; without corners, the bounding box of the scan's targets and a margin of 3 cm.

    Raises:
        RadarError: no corner given and no target recorded, or the box makes no sense.
    """
    import numpy as np

    from waveformer.simulator.grid import Grid

    if min_m is None or max_m is None:
        bounds_m = [target["bounds_m"] for target in measurement.metadata.get("targets", [])]
        if not bounds_m:
            raise RadarError(
                "the scan does not say where its targets are: give --min X Y Z and --max X Y Z in metres"
            )
        low, high = np.min(bounds_m, axis=(0, 1)) - _MARGIN_M, np.max(bounds_m, axis=(0, 1)) + _MARGIN_M
        return Grid.box(low if min_m is None else min_m, high if max_m is None else max_m, spacing_m)
    return Grid.box(min_m, max_m, spacing_m)


def form_image(measurement: Measurement, grid: Grid, seed: int = 0) -> Image:
    """Backproject a scan; progress goes to stderr. The image's metadata hold those of the scan."""
    from waveformer.simulator.image import Image
    from waveformer.simulator.imaging import backproject

    with progress("imaging") as report:
        values = backproject(measurement, grid, progress=report)
    metadata = {"scan": measurement.metadata, "seed": seed, "waveformer_version": __version__}
    return Image(values, grid, metadata)
