"""Where the walls that a way crosses change within a tile: there nothing may be interpolated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.occluders import Box

# The point of crossing moves by no more than this times the move of the sample.
_MARGIN = 1.5


def leaving_changes(
    box: Box, points_m: NDArray[np.float64], radius_m: float, antennas_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether ways from inside the box may leave it by different walls.

    Args:
        box: the box.
        points_m: centres of groups of samples inside it, shape (Q, 3).
        radius_m: largest distance of a sample from its group's centre.
        antennas_m: positions outside it, shape (A, 3); those between them are covered, too.

    Returns:
        Shape (Q,).
    """
    low, high = box.middle_min_m, box.middle_max_m
    corners = bounding_corners(antennas_m)
    walls = np.empty((len(corners), len(points_m)), dtype=np.int64)
    near_edge = np.zeros(len(points_m), dtype=bool)
    for index, corner in enumerate(corners):
        walls[index], crossing = leaving_wall(box, points_m, corner)
        clearance = np.minimum(crossing - low, high - crossing)
        clearance[np.arange(len(points_m)), walls[index] // 2] = np.inf
        near_edge |= clearance.min(axis=1) < _MARGIN * radius_m
    return np.asarray(near_edge | (walls != walls[0]).any(axis=0))


def leaving_wall(
    box: Box, points_m: NDArray[np.float64], antenna_m: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Which wall the ways from points inside a box (Q, 3) to an antenna cross, 2 axis + upper, and where (Q, 3)."""
    low, high = box.middle_min_m, box.middle_max_m
    way = antenna_m - points_m
    to_wall = np.where(way > 0, high - points_m, points_m - low)
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = np.where(way != 0, to_wall / np.abs(way), np.inf)
    axis, row = fraction.argmin(axis=1), np.arange(len(points_m))
    return 2 * axis + (way[row, axis] > 0), points_m + fraction[row, axis][:, None] * way


def meets_box(
    box: Box, points_m: NDArray[np.float64], radius_m: float, antennas_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether any way from outside the box may meet it; arguments as in `leaving_changes`, shape (Q,)."""
    low, high = box.middle_min_m - _MARGIN * radius_m, box.middle_max_m + _MARGIN * radius_m
    # all ways lie in the hull of the point and the antennas' bounding box
    lowest = np.minimum(points_m, antennas_m.min(axis=0))
    highest = np.maximum(points_m, antennas_m.max(axis=0))
    return np.asarray(((lowest < high) & (highest > low)).all(axis=1))


def bounding_corners(positions_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distinct corners of the bounding box of positions (N, 3)."""
    low, high = positions_m.min(axis=0), positions_m.max(axis=0)
    return np.unique(
        np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3), axis=0
    )
