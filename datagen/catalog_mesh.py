"""A file of a collection as a mesh in the catalogue's frame: metres, z up, centred; and what identifies its shape."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import stat
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.catalog_items import UpAxis
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.mesh_files import read_triangles
from waveformer.simulator.mesh_formats import one_line
from waveformer.simulator.mesh_repair import largest_side, used_vertices

_TO_Z_UP: dict[UpAxis, NDArray[np.float64]] = {
    "x": np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
# Outside of this range a coordinate is no length in whatever unit, but damage.
_SIDE_RANGE = (1e-6, 1e9)
_MIN_THICKNESS = 1e-6
_MIN_WIDTH = 0.004
_HASH_DECIMALS = 3
_BLOCK_BYTES = 1 << 20


def load_placed(path: Path, unit_m: float | None, up_axis: UpAxis) -> SurfaceMesh:
    """The cleaned mesh of a file: z up, bounding box centred at 0; bodies turned inside out are flipped.

    Args:
        path: of the file.
        unit_m: metres per unit of the file; None makes the longest side 1.
        up_axis: of the file.

    Raises:
        MeshError: as `load_mesh`, and ``mesh.flat`` or ``mesh.thin`` for what encloses no shape worth sampling.
    """
    raw = read_triangles(path)
    if unit_m is None:
        unit_m = _unit_of_side_one(raw.name, used_vertices(raw.vertices, raw.faces)[0])
    mesh = load_mesh(raw, fix_winding=True, unit_m=unit_m)
    _require_body(mesh)
    vertices_m = mesh.vertices_m @ _TO_Z_UP[up_axis].T
    centre_m = (vertices_m.min(axis=0) + vertices_m.max(axis=0)) / 2
    return dataclasses.replace(mesh, vertices_m=vertices_m - centre_m)


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes.

    Raises:
        MeshError: it is not a regular file, or cannot be read.
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise MeshError(
                "mesh.unreadable", f"{one_line(path.name)}: not a regular file; name one mesh file"
            )
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while block := file.read(_BLOCK_BYTES):
                digest.update(block)
    except OSError as error:
        raise MeshError(
            "mesh.unreadable",
            f"{one_line(path.name)}: cannot be read ({error.strerror}); check its permissions",
        ) from error
    return digest.hexdigest()


def geometry_sha256(mesh: SurfaceMesh) -> str:
    """SHA-256 of what two files of the same shape have in common.

    That is the number of vertices and faces and six rounded integrals over the surface, free of scale: principal
    radii, volume, fourth moment, and how unequal the faces are. So neither the order of vertices and faces matters
    nor file format, unit, place, orientation or mirroring. Copies that differ in the sixth digit of a coordinate
    are missed about once in a hundred.
    """
    triangles = mesh.triangles_m
    areas = mesh.areas_m2
    area = float(areas.sum())
    scale = np.sqrt(area)
    middles = triangles.mean(axis=1)
    centre = (areas @ middles) / area
    corners = (triangles - centre) / scale
    sums = corners.sum(axis=1)
    weights = areas / area / 12.0
    # Exact for triangles: the mean of x x^T is (sum of v v^T over corners + s s^T) / 12 with s the sum of corners.
    moments = np.einsum("f,fki,fkj->ij", weights, corners, corners) + np.einsum(
        "f,fi,fj->ij", weights, sums, sums
    )
    radii = np.sqrt(np.clip(np.linalg.eigvalsh(moments), 0.0, None))
    volume = abs(np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))) / 6.0
    fourth = float(areas @ np.square(np.square((middles - centre) / scale).sum(axis=1))) / area
    unequal = np.log(len(areas) * np.square(areas / area).sum())
    numbers = [*(4.0 * radii), 4.0 * np.cbrt(volume), 4.0 * fourth**0.25, unequal]
    rounded = " ".join(
        f"{abs(round(float(number), _HASH_DECIMALS)):.{_HASH_DECIMALS}f}" for number in numbers
    )
    text = f"waveformer.geometry 1 {len(mesh.vertices_m)} {len(mesh.faces)} {rounded}"
    return hashlib.sha256(text.encode()).hexdigest()


def _unit_of_side_one(name: str, vertices: NDArray[np.float64]) -> float:
    """What makes the longest side 1; also 1 for what `load_mesh` will refuse with the better reason."""
    if len(vertices) == 0 or not np.isfinite(vertices).all() or (side := largest_side(vertices)) == 0:
        return 1.0
    if not _SIDE_RANGE[0] <= side <= _SIDE_RANGE[1]:
        code, what = ("mesh.too_large", "large") if side > 1 else ("mesh.too_small", "small")
        raise MeshError(
            code, f"{name}: its longest side of {side:.3g} units is too {what} for a length; export it again"
        )
    return 1.0 / side


def _require_body(mesh: SurfaceMesh) -> None:
    low, middle, high = np.sort(mesh.extent_m)
    if middle < _MIN_WIDTH * high:
        raise MeshError(
            "mesh.thin",
            f"{mesh.name}: a needle (second side less than {_MIN_WIDTH:g} of the longest): no shape to sample, "
            "or one stray vertex far away; check the mesh",
        )
    if low < _MIN_THICKNESS * high:
        raise MeshError("mesh.flat", f"{mesh.name}: flat (no thickness at all): give a mesh of a body")
