"""`waveformer view`: look at scans, images and meshes in three dimensions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from waveformer.cli.report import print_notes, print_result
from waveformer.simulator.errors import StoreError

if TYPE_CHECKING:
    from waveformer.eval.scene import Layer


def view(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", help="Scans, images and mesh files.")],
    out: Annotated[
        Path,
        typer.Option(help="view.html can be turned with the mouse in any browser, view.png is a picture."),
    ] = Path("view.html"),
    mesh: Annotated[
        Path | None, typer.Option(help="Where the mesh of the scan lies now, if it was moved or renamed.")
    ] = None,
    unit: Annotated[str, typer.Option(help="Length unit of mesh files among PATH: m, cm, mm or in.")] = "m",
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Draw antenna positions, meshes, boxes and image surfaces, in one self-contained HTML file or a PNG."""
    from waveformer.simulator.storage import check_file_writable

    check_file_writable(out, force)
    if out.suffix not in (".html", ".png"):
        raise StoreError(f"{out}: the picture must end in .html or .png")
    layers, notes = collect_layers(paths, mesh, unit)
    notes += write_view(layers, out, force)
    print_notes(notes)
    names = [layer.name for layer in layers]
    print_result(
        {"out": str(out), "layers": names, "notes": notes}, f"{out}: {', '.join(names)}", json_output
    )


def collect_layers(
    paths: list[Path], moved_mesh: Path | None = None, unit: str = "m"
) -> tuple[list[Layer], list[str]]:
    """Everything there is to draw in some files.

    Args:
        paths: scans, images and mesh files; the meshes that scans and images were made of come with them.
        moved_mesh: where the mesh of the scan lies now.
        unit: length unit of the mesh files.

    Returns:
        Layers, and remarks about meshes that are not drawn.

    Raises:
        StoreError, MeshError: a path cannot be read, or the unit is unknown.
    """
    from waveformer.cli.overlay import recorded_box, recorded_meshes
    from waveformer.cli.scan_config import UNITS_M
    from waveformer.eval.scene import scene_layers
    from waveformer.simulator.image import IMAGE_FORMAT, Image
    from waveformer.simulator.measurement import MEASUREMENT_FORMAT, Measurement
    from waveformer.simulator.mesh import load_mesh
    from waveformer.simulator.storage import store_format

    if unit not in UNITS_M:
        raise StoreError(f"unknown unit {unit!r}; known: {', '.join(UNITS_M)}")
    found = {path: store_format(path) for path in paths}
    for path in paths:
        if not path.exists():
            raise StoreError(f"{path} does not exist")
        if path.is_dir() and found[path] not in (MEASUREMENT_FORMAT, IMAGE_FORMAT):
            raise StoreError(f"{path} is neither a scan nor an image of waveformer, nor a mesh file")
    layers: list[Layer] = []
    origins = []
    for path in paths:
        if found[path] == MEASUREMENT_FORMAT:
            scan = Measurement.load(path)
            layers += scene_layers(aperture=scan.aperture)
            origins.append(scan.metadata)
        elif found[path] == IMAGE_FORMAT:
            image = Image.load(path)
            layers += scene_layers(image=image)
            origins.append(image.metadata.get("scan", {}))
        else:
            layers += scene_layers(meshes=[load_mesh(path, unit_m=UNITS_M[unit])])
    notes: list[str] = []
    drawn: list[object] = []
    for origin in origins:
        objects = [origin.get(name) for name in ("meshes", "scene", "surroundings")]
        if objects not in drawn:  # a scan and its image share their objects
            drawn.append(objects)
            meshes, remarks = recorded_meshes(origin, moved_mesh)
            layers += scene_layers(meshes=meshes, box_m=recorded_box(origin))
            notes += remarks
    return layers, notes


def write_view(layers: list[Layer], out: Path, overwrite: bool) -> list[str]:
    """Write the scene as HTML or PNG, by the suffix of `out`; returns remarks."""
    from waveformer.eval.viewer import export_html, render_png
    from waveformer.simulator.storage import publish_file

    with publish_file(out, overwrite=overwrite) as temporary:
        if out.suffix == ".html":
            export_html(layers, temporary)
            return []
        reason = render_png(layers, temporary)
    return [] if reason is None else [f"{out} was drawn with matplotlib, because {reason}"]
