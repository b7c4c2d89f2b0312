"""Closed surfaces stretched over a sequence of loops: solids of revolution and bars of changing outline."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import trimesh

# Corners of one closed outline, shape (n, 3), or one point (1, 3) where the surface ends.
Loop = NDArray[np.float64]

# Neighbouring corners and neighbouring loops stay this fraction of the longest edge apart, so that the
# diagonals keep below it, also on the outside of a bend.
_SPACING_FRACTION = 0.58


def loft(loops: Sequence[Loop]) -> trimesh.Trimesh:
    """The surface over consecutive loops.

    Normals point outwards if every loop turns by the right-hand rule about the direction of travel; a loop
    that starts or ends with a single point is closed there.
    """
    import trimesh

    starts = np.cumsum([0, *(len(loop) for loop in loops)])
    faces = [
        start + _stitch(len(lower), len(upper))
        for start, (lower, upper) in zip(starts, itertools.pairwise(loops), strict=False)
    ]
    return trimesh.Trimesh(np.concatenate(loops), np.concatenate(faces), process=False)


def lathe(profile: Sequence[tuple[float, float]], edge_m: float) -> trimesh.Trimesh:
    """A solid of revolution around the z axis.

    Args:
        profile: (radius, z) corners in metres, outside to the right of the direction of travel: from the
            bottom up for a convex solid.
        edge_m: longest edge.
    """
    corners = np.array(profile)
    rows = [corners[:1]]
    for start, end in itertools.pairwise(corners):
        steps = max(1, math.ceil(math.dist(start, end) / (_SPACING_FRACTION * edge_m)))
        rows.append(start + np.linspace(0, 1, steps + 1)[1:, None] * (end - start))
    return loft([circle(radius_m, z_m, edge_m) for radius_m, z_m in np.concatenate(rows)])


def bar(loops: Sequence[Loop], edge_m: float) -> trimesh.Trimesh:
    """The surface over loops, both ends closed by flat caps."""
    return loft([*_cap(loops[0], edge_m)[::-1], *loops, *_cap(loops[-1], edge_m)])


def circle(radius_m: float, z_m: float, edge_m: float) -> Loop:
    """A circle around the z axis; one point for radius 0."""
    if radius_m == 0:
        return np.array([[0.0, 0.0, z_m]])
    segments = max(3, math.ceil(2 * math.pi * radius_m / (_SPACING_FRACTION * edge_m)))
    angle = np.arange(segments) * (2 * np.pi / segments)
    return np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.full(segments, z_m)], axis=1)


def superellipse(
    center_m: ArrayLike,
    half_axes_m: tuple[ArrayLike, ArrayLike],
    exponent: float,
    edge_m: float,
) -> Loop:
    """The outline |a / half_a|^p + |b / half_b|^p = 1: an ellipse for p = 2, a rounded rectangle for p = 4.

    Args:
        center_m: (3,).
        half_axes_m: two vectors (3,) whose cross product points in the direction of travel.
        exponent: p.
        edge_m: longest edge.
    """
    angle = np.linspace(0, 2 * np.pi, 2049)
    first, second = np.asarray(half_axes_m)
    a, b = (np.sign(wave) * np.abs(wave) ** (2 / exponent) for wave in (np.cos(angle), np.sin(angle)))
    points = np.asarray(center_m) + a[:, None] * first + b[:, None] * second
    return resample(points, edge_m)[:-1]


def arc(
    center: tuple[float, float], radius_m: float, start_deg: float, end_deg: float
) -> list[tuple[float, float]]:
    """Corners (radius, z) of a rounded part of a profile, every 11.25 degrees."""
    angles = np.radians(np.linspace(start_deg, end_deg, round(abs(end_deg - start_deg) / 11.25) + 1))
    return [
        (center[0] + radius_m * math.cos(angle), center[1] + radius_m * math.sin(angle)) for angle in angles
    ]


def resample(points_m: NDArray[np.float64], edge_m: float) -> NDArray[np.float64]:
    """A polyline (n, d) divided into equal lengths, short enough for edges of a loft."""
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))])
    steps = max(3, math.ceil(lengths[-1] / (_SPACING_FRACTION * edge_m)))
    at = np.linspace(0, lengths[-1], steps + 1)
    return np.stack([np.interp(at, lengths, column) for column in points_m.T], axis=1)


def _cap(loop: Loop, edge_m: float) -> list[Loop]:
    """Loops that shrink a loop to its centre, without the loop itself."""
    center = loop.mean(axis=0, keepdims=True)
    radius_m = np.linalg.norm(loop - center, axis=1).max()
    steps = math.ceil(radius_m / (_SPACING_FRACTION * edge_m))
    closed = np.concatenate([loop, loop[:1]])
    scaled = [
        resample(center + (1 - step / steps) * (closed - center), edge_m)[:-1] for step in range(1, steps)
    ]
    return [*scaled, center]


def _stitch(lower: int, upper: int) -> NDArray[np.int64]:
    """Triangles between two loops of ``lower`` and ``upper`` corners, numbered one after the other.

    Walks around both loops at once and always takes the step whose middle comes first.
    """
    # One point is no loop: it has no steps of its own.
    lower_steps, upper_steps = (0 if count == 1 else count for count in (lower, upper))
    middles = np.concatenate(
        [(np.arange(count) + 0.5) / max(count, 1) for count in (lower_steps, upper_steps)]
    )
    is_lower = (np.arange(len(middles)) < lower_steps)[np.argsort(middles, kind="stable")]
    # Steps taken around each loop before this one.
    low = np.concatenate([[0], np.cumsum(is_lower)[:-1]])
    high = np.arange(len(low)) - low
    next_corner = np.where(is_lower, (low + 1) % lower, lower + (high + 1) % upper)
    return np.stack([low % lower, next_corner, lower + high % upper], axis=1)
