"""Meshes built in code: shapes with a closed form, and everyday objects of real size.

All lengths are metres, no edge is longer than ``edge_m``, and closed shapes have outward normals. The default
edge keeps the facets of curved objects below half a wavelength at 77 GHz, so that they do not act as mirrors.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.lofting import arc, bar, circle, lathe, loft, resample, superellipse

if TYPE_CHECKING:
    import trimesh

DEFAULT_EDGE_M = 1.5e-3
_MIN_RIM_SEGMENTS = 1024


def sphere(radius_m: float, edge_m: float = DEFAULT_EDGE_M) -> trimesh.Trimesh:
    """An icosphere around the origin, vertices on the sphere, subdivided until no edge exceeds ``edge_m``."""
    import trimesh

    _require_positive(radius_m=radius_m, edge_m=edge_m)
    # An icosahedron has edges of 1.0515 radii; the projection stretches the subdivided ones by up to 1.18.
    subdivisions = max(0, math.floor(math.log2(1.0515 * radius_m / edge_m)))
    while True:
        mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m)
        if mesh.edges_unique_length.max() <= edge_m:
            return mesh
        subdivisions += 1


def plate(
    side_x_m: float, side_y_m: float, edge_m: float = math.inf, *, center_m: ArrayLike = (0.0, 0.0, 0.0)
) -> trimesh.Trimesh:
    """A flat rectangle with normal +z, an open sheet."""
    _require_positive(side_x_m=side_x_m, side_y_m=side_y_m, edge_m=edge_m)
    vertices, faces = _grid((side_x_m, side_y_m), edge_m)
    return _trimesh(vertices + np.asarray(center_m, float), faces)


def disc(radius_m: float, edge_m: float = math.inf) -> trimesh.Trimesh:
    """A flat disc around the origin with normal +z, an open sheet.

    Its rim has at least 1024 segments whatever the edge, and the area of the polygon is exactly pi radius^2.
    """
    _require_positive(radius_m=radius_m, edge_m=edge_m)
    segments = max(_MIN_RIM_SEGMENTS, math.ceil(2 * math.pi * radius_m / edge_m))
    rim_radius_m = radius_m / math.sqrt(np.sinc(2 / segments))
    radii_m = np.linspace(rim_radius_m, 0, max(1, math.ceil(2 * rim_radius_m / edge_m)) + 1)
    angle = np.arange(segments) * (2 * np.pi / segments)
    rim = rim_radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(segments)], axis=1)
    return loft([rim, *(circle(inner_m, 0.0, edge_m) for inner_m in radii_m[1:])])


def box(
    side_x_m: float,
    side_y_m: float,
    side_z_m: float,
    edge_m: float = math.inf,
    *,
    center_m: ArrayLike = (0.0, 0.0, 0.0),
) -> trimesh.Trimesh:
    """A closed cuboid; twelve triangles unless ``edge_m`` asks for more."""
    sides_m = np.array([side_x_m, side_y_m, side_z_m])
    _require_positive(side_x_m=side_x_m, side_y_m=side_y_m, side_z_m=side_z_m, edge_m=edge_m)
    vertices, faces, offset = [], [], 0
    for axis in range(3):
        across = [(axis + 1) % 3, (axis + 2) % 3]
        for side in (-1, 1):
            flat, triangles = _grid(sides_m[across], edge_m)
            corners = np.empty_like(flat)
            corners[:, across], corners[:, axis] = flat[:, :2], side * sides_m[axis] / 2
            vertices.append(corners)
            faces.append((triangles if side > 0 else triangles[:, ::-1]) + offset)
            offset += len(flat)
    mesh = _trimesh(np.concatenate(vertices) + np.asarray(center_m, float), np.concatenate(faces))
    mesh.merge_vertices()
    return mesh


def cylinder(radius_m: float, length_m: float, edge_m: float = DEFAULT_EDGE_M) -> trimesh.Trimesh:
    """A closed cylinder around the z axis, centred on the origin."""
    _require_positive(radius_m=radius_m, length_m=length_m, edge_m=edge_m)
    half_m = length_m / 2
    return lathe([(0, -half_m), (radius_m, -half_m), (radius_m, half_m), (0, half_m)], edge_m)


def mug(
    edge_m: float = DEFAULT_EDGE_M,
    *,
    height_m: float = 0.09,
    diameter_m: float = 0.08,
    wall_m: float = 0.004,
) -> trimesh.Trimesh:
    """A mug that stands on z = 0 around the z axis, handle towards +x.

    Two closed bodies: the cup, hollow and open at the top, and the handle, whose ends reach into the wall.
    """
    _require_positive(edge_m=edge_m, height_m=height_m, diameter_m=diameter_m, wall_m=wall_m)
    radius_m, lip_m, foot_m = diameter_m / 2, wall_m / 2, wall_m
    if not wall_m < min(radius_m, height_m) / 4:
        raise MeshError("mesh.primitive", f"a mug's wall of {wall_m:g} m needs a wider and higher mug")
    profile = [
        (0.0, 0.0),
        *arc((radius_m - foot_m, foot_m), foot_m, -90, 0),
        *arc((radius_m - lip_m, height_m - lip_m), lip_m, 0, 180),
        *arc((radius_m - wall_m - foot_m, wall_m + foot_m), foot_m, 0, -90),
        (0.0, wall_m),
    ]
    # Half an ellipse that leaves the wall at a right angle and starts within it.
    angle = np.linspace(-np.pi / 2, np.pi / 2, 361)
    reach_m, half_height_m = 0.35 * diameter_m, 0.31 * height_m
    bend = np.stack([reach_m * np.cos(angle), 0 * angle, half_height_m * np.sin(angle)], axis=1)
    path = resample(bend + np.array([radius_m - 0.6 * wall_m, 0, height_m / 2]), edge_m)
    width = np.array([0, 0.07 * diameter_m, 0])
    tangents = np.gradient(path, axis=0)
    tangents[0], tangents[-1] = [1, 0, 0], [-1, 0, 0]
    thickness = np.cross(
        tangents / np.linalg.norm(tangents, axis=1, keepdims=True), [0, 0.045 * diameter_m, 0]
    )
    handle = [
        superellipse(point, (width, half), 2.0, edge_m) for point, half in zip(path, thickness, strict=True)
    ]
    return _join([lathe(profile, edge_m), bar(handle, edge_m)])


def hammer(edge_m: float = DEFAULT_EDGE_M) -> trimesh.Trimesh:
    """A claw hammer of 0.3 m that lies flat: handle along x, head of 0.1 m along y, thickness along z.

    Two closed bodies, head and handle, see ``hammer_head`` and ``hammer_handle``.
    """
    return _join([hammer_head(edge_m), hammer_handle(edge_m)])


def hammer_head(edge_m: float = DEFAULT_EDGE_M) -> trimesh.Trimesh:
    """The steel head: a round face at -y, a neck, a square body and a bent claw that thins out towards +y."""
    _require_positive(edge_m=edge_m)
    # y, bend towards +x, half width along x, half thickness along z, exponent of the outline.
    stations = np.array(
        [
            [-0.0500, 0.000, 0.0125, 0.0125, 2.0],
            [-0.0490, 0.000, 0.0135, 0.0135, 2.0],
            [-0.0370, 0.000, 0.0135, 0.0135, 2.0],
            [-0.0320, 0.000, 0.0100, 0.0100, 2.0],
            [-0.0230, 0.000, 0.0100, 0.0100, 2.0],
            [-0.0160, 0.000, 0.0130, 0.0115, 4.0],
            [0.0120, 0.000, 0.0130, 0.0115, 4.0],
            [0.0200, 0.001, 0.0090, 0.0125, 4.0],
            [0.0350, 0.006, 0.0055, 0.0145, 4.0],
            [0.0500, 0.016, 0.0015, 0.0160, 4.0],
        ]
    )
    return bar(
        [
            superellipse((bend, along, 0), ((0, 0, thickness), (width, 0, 0)), exponent, edge_m)
            for along, bend, width, thickness, exponent in _stations(stations, edge_m)
        ],
        edge_m,
    )


def hammer_handle(edge_m: float = DEFAULT_EDGE_M) -> trimesh.Trimesh:
    """The wooden handle: an elliptic bar that passes through the head and swells at the grip."""
    _require_positive(edge_m=edge_m)
    # x, 0, half width along y, half thickness along z, exponent of the outline.
    stations = np.array(
        [
            [-0.0160, 0.0, 0.0095, 0.0075, 2.0],
            [0.0150, 0.0, 0.0095, 0.0075, 2.0],
            [0.1000, 0.0, 0.0110, 0.0090, 2.0],
            [0.1700, 0.0, 0.0150, 0.0115, 2.0],
            [0.2500, 0.0, 0.0145, 0.0115, 2.0],
            [0.2780, 0.0, 0.0165, 0.0125, 2.0],
            [0.2840, 0.0, 0.0140, 0.0105, 2.0],
        ]
    )
    return bar(
        [
            superellipse((along, 0, 0), ((0, width, 0), (0, 0, thickness)), exponent, edge_m)
            for along, _, width, thickness, exponent in _stations(stations, edge_m)
        ],
        edge_m,
    )


def _stations(table: NDArray[np.float64], edge_m: float) -> NDArray[np.float64]:
    """Rows of a table smoothly interpolated over its first column, close enough for edges of ``edge_m``."""
    from scipy.interpolate import PchipInterpolator

    dense = PchipInterpolator(table[:, 0], table[:, 1:])(
        along := np.linspace(table[0, 0], table[-1, 0], 2001)
    )
    dense = np.concatenate([along[:, None], dense], axis=1)
    # A corner moves along the bar and, at the same time, with the bend, the size and the shape of the outline
    # (from an ellipse to exponent 4 its diagonal grows by 0.19 half axes).
    along_m, bend_m, width_m, thickness_m, exponent = np.abs(np.diff(dense, axis=0)).T
    reshape_m = 0.1 * exponent * dense[1:, 2:4].max(axis=1)
    travel = np.hypot(along_m, bend_m + np.maximum(width_m, thickness_m) + reshape_m)
    length = np.concatenate([[0], np.cumsum(travel)])
    at = resample(length[[0, -1], None], edge_m)[:, 0]
    return np.stack([np.interp(at, length, column) for column in dense.T], axis=1)


def _grid(sides_m: ArrayLike, edge_m: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A rectangle around the origin in the plane z = 0 as equal right triangles with normal +z."""
    sides = np.asarray(sides_m, float)
    num_x, num_y = (max(1, math.ceil(side * math.sqrt(2) / edge_m)) for side in sides)
    x, y = np.meshgrid(
        np.linspace(-sides[0] / 2, sides[0] / 2, num_x + 1),
        np.linspace(-sides[1] / 2, sides[1] / 2, num_y + 1),
    )
    corner = (np.arange(num_y)[:, None] * (num_x + 1) + np.arange(num_x)).ravel()
    right, up, diagonal = corner + 1, corner + num_x + 1, corner + num_x + 2
    faces = np.stack([corner, right, diagonal, corner, diagonal, up], axis=1).reshape(-1, 3)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), faces


def _join(bodies: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    offsets = np.cumsum([0, *(len(body.vertices) for body in bodies[:-1])])
    return _trimesh(
        np.concatenate([body.vertices for body in bodies]),
        np.concatenate([body.faces + offset for body, offset in zip(bodies, offsets, strict=True)]),
    )


def _trimesh(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> trimesh.Trimesh:
    import trimesh

    return trimesh.Trimesh(vertices, faces, process=False)


def _require_positive(**lengths_m: float) -> None:
    for name, value in lengths_m.items():
        if not value > 0:
            raise MeshError("mesh.primitive", f"{name} must be a positive number of metres, got {value!r}")
