"""Regular voxels: edge lengths and positions of the voxels of a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

# Coordinates built by repeated addition drift by a few rounding errors, never by a thousandth of a voxel.
_REGULAR = 1e-3


def voxel_edges_m(grid: Grid) -> NDArray[np.float64]:
    """Edge lengths of the voxels along x, y and z, shape (3,), metres.

    An axis of a single voxel has no spacing of its own and takes the shortest edge of the others.

    Raises:
        RadarError: an axis is not evenly spaced, or the grid is a single voxel.
    """
    edges = np.full(3, np.inf)
    for position, name in enumerate(("x", "y", "z")):
        axis = getattr(grid, name)
        if len(axis) == 1:
            continue
        steps = np.diff(axis)
        edges[position] = (axis[-1] - axis[0]) / (len(axis) - 1)
        if np.abs(steps - edges[position]).max() > _REGULAR * edges[position]:
            raise RadarError(
                f"grid axis {name} is not evenly spaced ({steps.min():g} to {steps.max():g} m): "
                "candidate surfaces need a regular grid, e.g. Grid.box"
            )
    if np.isinf(edges).all():
        raise RadarError("a grid of a single voxel has no spacing: give at least two voxels along one axis")
    return np.where(np.isinf(edges), edges.min(), edges)


def cubic_edge_m(grid: Grid) -> float:
    """Edge length of cubic voxels, metres.

    Raises:
        RadarError: the voxels are not cubes.
    """
    edges = voxel_edges_m(grid)
    if edges.max() > (1 + _REGULAR) * edges.min():
        sizes = " x ".join(f"{edge * 1e3:g}" for edge in edges)
        raise RadarError(f"voxels of {sizes} mm are not cubes: give delta_m, or image on a Grid.box")
    return float(edges.mean())


def voxel_positions_m(grid: Grid, index: NDArray[np.int64]) -> NDArray[np.float64]:
    """Centres of voxels, shape (V, 3), metres.

    Args:
        grid: the grid.
        index: voxels (i, j, k), shape (V, 3).
    """
    return np.stack([grid.x[index[:, 0]], grid.y[index[:, 1]], grid.z[index[:, 2]]], axis=1)
