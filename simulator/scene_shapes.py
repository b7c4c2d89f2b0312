"""Shapes of a Mitsuba scene as targets: mesh files as they are, analytic shapes tessellated, all in float64."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator import primitives
from waveformer.simulator.errors import RadarError
from waveformer.simulator.lofting import lathe
from waveformer.simulator.materials import Material
from waveformer.simulator.mesh_files import read_triangles
from waveformer.simulator.target import Target

if TYPE_CHECKING:
    import trimesh

# Longest edge on curved analytic shapes, about a quarter wavelength at 80 GHz; flat ones get as few
# triangles as will do, since the surface integral subdivides them.
CURVED_EDGE_M = 1e-3

_ALIGNED = 1e-9
_RIGID = 1e-6


@dataclass(frozen=True, eq=False)
class Shape:
    """One shape of a scene as it was written.

    Attributes:
        label: what messages call it.
        plugin: name of the Mitsuba plugin.
        values: its parameters, name -> value, without to_world.
        to_world: affine transform (4, 4).
        folder: where relative file names start.
    """

    label: str
    plugin: str
    values: Mapping[str, Any]
    to_world: NDArray[np.float64]
    folder: Path

    @property
    def linear(self) -> NDArray[np.float64]:
        """Upper left part of to_world, shape (3, 3)."""
        return self.to_world[:3, :3]

    @property
    def position_m(self) -> NDArray[np.float64]:
        """Where to_world puts the origin, shape (3,)."""
        return self.to_world[:3, 3]


def shape_target(shape: Shape, material: Material) -> Target:
    """The target that a shape is.

    A mesh file with a rigid to_world becomes a path and a pose, so it is the same target as one written in Python;
    any other to_world is applied to the vertices. An analytic shape may be moved, turned and scaled.

    Raises:
        RadarError: an unknown shape or parameter, by name with the known ones, or a to_world that makes no sense.
        MeshError: a mesh file cannot be read.
    """
    if shape.plugin not in SHAPES:
        raise RadarError(
            f"{shape.label}: the radar knows no shape {shape.plugin!r}; known: {', '.join(sorted(SHAPES))}"
        )
    known, build = SHAPES[shape.plugin]
    for name in shape.values:
        if name not in known:
            raise RadarError(
                f"{shape.label}: {shape.plugin} has no parameter {name!r}; known: {', '.join(sorted((*known, 'to_world')))}"
            )
    mesh, pose = build(shape)
    return Target(mesh, material, pose)


def principal_axes(shape: Shape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation (3, 3) and scales (3,) of a to_world that does not shear.

    A mirrored shape is turned the right way round along its own x axis, about which all analytic shapes are alike.
    """
    scales = np.linalg.norm(shape.linear, axis=0)
    if not (scales > 0).all():
        raise RadarError(f"{shape.label}: to_world squeezes the shape flat")
    rotation = shape.linear / scales
    if np.abs(rotation.T @ rotation - np.eye(3)).max() > _RIGID:
        raise RadarError(f"{shape.label}: to_world shears a {shape.plugin}; give a mesh file for that")
    if np.linalg.det(rotation) < 0:
        rotation = rotation * [-1.0, 1.0, 1.0]
    return rotation, scales


def axis_aligned_bounds(shape: Shape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Corners of a cube whose faces stay along the axes, shape (3,) each."""
    half_sides = np.abs(shape.linear).sum(axis=1)
    if (np.sort(np.abs(shape.linear), axis=1)[:, :2] > _ALIGNED * half_sides.max()).any():
        raise RadarError(f"{shape.label}: a box of sheets must have its edges along the axes")
    return shape.position_m - half_sides, shape.position_m + half_sides


_Mesh = tuple["trimesh.Trimesh | Path", NDArray[np.float64]]


def _file(shape: Shape) -> _Mesh:
    filename = shape.values.get("filename")
    if not isinstance(filename, str):
        raise RadarError(f"{shape.label}: {shape.plugin} needs filename")
    path = shape.folder / filename
    flip = shape.values.get("flip_normals", False)
    is_rigid = np.abs(shape.linear.T @ shape.linear - np.eye(3)).max() <= _RIGID
    mirrors = np.linalg.det(shape.linear) < 0
    if is_rigid and not mirrors and not flip:
        return path, shape.to_world
    import trimesh

    raw = read_triangles(path)
    vertices = np.einsum("ni,ji->nj", raw.vertices, shape.linear) + shape.position_m
    faces = raw.faces[:, ::-1] if mirrors != flip else raw.faces
    mesh = trimesh.Trimesh(vertices, faces, process=False, metadata={"name": raw.name})
    return mesh, np.eye(4)


def _sphere(shape: Shape) -> _Mesh:
    rotation, scale = _similarity(shape)
    center = _vector(shape, "center", (0.0, 0.0, 0.0))
    radius_m = _radius(shape) * scale
    return primitives.sphere(radius_m, CURVED_EDGE_M), _pose(rotation, _world(shape, center))


def _cylinder(shape: Shape) -> _Mesh:
    _, scale = _similarity(shape)
    ends = [
        _world(shape, _vector(shape, name, default))
        for name, default in (("p0", (0.0, 0.0, 0.0)), ("p1", (0.0, 0.0, 1.0)))
    ]
    length_m = float(np.linalg.norm(ends[1] - ends[0]))
    if not length_m > 0:
        raise RadarError(f"{shape.label}: p0 and p1 of a cylinder must differ")
    radius_m = _radius(shape) * scale
    tube = lathe([(radius_m, -length_m / 2), (radius_m, length_m / 2)], CURVED_EDGE_M)
    return tube, _pose(_frame((ends[1] - ends[0]) / length_m), (ends[0] + ends[1]) / 2)


def _disk(shape: Shape) -> _Mesh:
    rotation, scales = principal_axes(shape)
    if not math.isclose(scales[0], scales[1], rel_tol=_RIGID):
        raise RadarError(f"{shape.label}: to_world makes an ellipse of a disk; give a mesh file for that")
    return primitives.disc(float(scales[0])), _pose(rotation, shape.position_m)


def _rectangle(shape: Shape) -> _Mesh:
    rotation, scales = principal_axes(shape)
    return primitives.plate(*(2 * scales[:2])), _pose(rotation, shape.position_m)


def _cube(shape: Shape) -> _Mesh:
    rotation, scales = principal_axes(shape)
    return primitives.box(*(2 * scales)), _pose(rotation, shape.position_m)


_MESH_FILE = ("filename", "face_normals", "flip_normals", "flip_tex_coords")
# Parameters of Mitsuba's shapes that the radar understands or may ignore, and the function that builds them.
SHAPES: dict[str, tuple[tuple[str, ...], Callable[[Shape], _Mesh]]] = {
    "ply": (_MESH_FILE, _file),
    "obj": (_MESH_FILE, _file),
    "sphere": (("center", "radius", "flip_normals"), _sphere),
    "cylinder": (("p0", "p1", "radius", "flip_normals"), _cylinder),
    "disk": (("flip_normals",), _disk),
    "rectangle": (("flip_normals",), _rectangle),
    "cube": (("flip_normals",), _cube),
}


def _similarity(shape: Shape) -> tuple[NDArray[np.float64], float]:
    rotation, scales = principal_axes(shape)
    if np.ptp(scales) > _RIGID * scales.max():
        raise RadarError(
            f"{shape.label}: to_world stretches a {shape.plugin} unevenly; give a mesh file for that"
        )
    return rotation, float(scales[0])


def _radius(shape: Shape) -> float:
    radius = shape.values.get("radius", 1.0)
    if isinstance(radius, bool) or not isinstance(radius, (int, float)) or not radius > 0:
        raise RadarError(f"{shape.label}: radius must be a positive number")
    return float(radius)


def _vector(shape: Shape, name: str, default: tuple[float, float, float]) -> NDArray[np.float64]:
    try:
        vector = np.array(shape.values.get(name, default), dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise RadarError(f"{shape.label}: {name} must be three finite numbers")
    return vector


def _world(shape: Shape, point: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(shape.linear @ point + shape.position_m)


def _pose(rotation: NDArray[np.float64], position_m: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position_m
    return pose


def _frame(axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """A rotation whose third column is a unit vector."""
    first = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)
