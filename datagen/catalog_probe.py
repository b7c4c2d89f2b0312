"""What a scan learns of one file; runs in a `Sandbox`, since files may be hostile."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from waveformer.datagen.catalog_items import UpAxis, printable
from waveformer.datagen.catalog_mesh import file_sha256, geometry_sha256, load_placed
from waveformer.simulator.errors import MeshError


def probe_mesh(path: str, unit_m: float | None, up_axis: UpAxis) -> dict[str, Any]:
    """Load a file and say what `CatalogEntry` wants to know; only what JSON can hold.

    Returns:
        Either reason, or sha256, geometry_sha256, faces, watertight, longest_side_m (1 where the unit is unknown)
        and problems.
    """
    try:
        mesh = load_placed(Path(path), unit_m, up_axis)
        sha256 = file_sha256(Path(path))
    except MeshError as error:
        return {"reason": printable(str(error))}
    problems = [printable(problem) for problem in mesh.problems]
    if mesh.two_sided:
        problems.append("not watertight: both sides of its faces count")
    return {
        "sha256": sha256,
        "geometry_sha256": geometry_sha256(mesh),
        "faces": len(mesh.faces),
        "watertight": not mesh.two_sided,
        "longest_side_m": float(mesh.extent_m.max()),
        "problems": problems,
    }
