"""Baselines without learning: the thresholded image, and partial clouds completed without knowing the shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.datagen.truth_cloud import finite_points
from waveformer.eval.swept_walls import Columns
from waveformer.model.voxels import voxel_positions_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

# 0.4 gives the paper's recall and Chamfer distance on the simulated twin; it prints no threshold.
BACKPROJECTION_SHARE = 0.4


def backprojection_cloud(
    image: NDArray[np.complex64], grid: Grid, share: float = BACKPROJECTION_SHARE
) -> NDArray[np.float64]:
    """Centres of the voxels with |S| above a share of the image's largest |S|.

    Args:
        image: focused S, (X, Y, Z).
        grid: its voxels.
        share: 0 <= share < 1.

    Returns:
        Shape (P, 3), metres; no points for an image that is zero everywhere.

    Raises:
        RadarError: the image does not fit the grid or is not finite, or the share is out of range.
    """
    if not 0 <= share < 1:
        raise RadarError(f"share of max |S| must be in 0 <= share < 1, got {share!r}")
    if np.shape(image) != grid.shape:
        raise RadarError(f"image of shape {np.shape(image)} does not fit the grid {grid.shape}")
    magnitude = np.abs(image)
    if not np.isfinite(magnitude).all():
        raise RadarError(f"the image holds {int((~np.isfinite(magnitude)).sum())} non-finite voxels")
    return voxel_positions_m(grid, np.argwhere(magnitude > share * magnitude.max()))


@dataclass(frozen=True, eq=False)
class Completion:
    """A completed cloud in its two parts.

    Attributes:
        partial_m: points of the partial cloud, (A, 3).
        hidden_m: points that were made up, (B, 3).
    """

    partial_m: NDArray[np.float64]
    hidden_m: NDArray[np.float64]

    @property
    def points_m(self) -> NDArray[np.float64]:
        """Both parts, (A + B, 3)."""
        return np.concatenate([self.partial_m, self.hidden_m])


def extrude_to_support(
    partial_m: ArrayLike,
    support_z_m: float,
    count: int,
    rng: np.random.Generator,
    *,
    cell_m: float = 0.003,
) -> Completion:
    """The partial cloud with vertical walls from its outline down to the support, and a floor.

    The points are sorted into square columns; gaps of one column are closed. The floor is the support plane below
    all columns. A wall stands on every side of a column whose neighbour there is empty (also around holes), from
    the support to the lowest point in the column; no wall where that is below the support. The points are shared
    out by area, the partial cloud with the area of its columns, and drawn at random on floor and walls; those of
    the partial cloud are thinned or repeated at random.

    Args:
        partial_m: (P, 3) metres, z up.
        support_z_m: height of the plane the object rests on.
        count: points in all, made up or not.
        rng: random numbers.
        cell_m: width of a column, at least the distance of neighbouring points.

    Returns:
        `count` points; no points at all without a partial cloud, and no hidden ones if all of it lies below the
        support.

    Raises:
        MeshError: the partial cloud has another shape or is not finite.
        RadarError: `support_z_m` or `cell_m` make no sense.
    """
    partial = _checked(partial_m, support_z_m)
    if not (np.isfinite(cell_m) and cell_m > 0):
        raise RadarError(f"cell_m must be positive metres, got {cell_m!r}")
    if not (partial[:, 2] > support_z_m).any():
        return Completion(_drawn(partial, count, rng), np.empty((0, 3)))
    columns = Columns.of_cloud(partial, support_z_m, cell_m)
    swept = columns.walls_and_floor()
    swept_m2 = float(swept.areas_m2.sum())
    num_hidden = round(count * swept_m2 / (swept_m2 + columns.footprint_m2))
    return Completion(_drawn(partial, count - num_hidden, rng), swept.sample(num_hidden, rng))


def mirror(partial_m: ArrayLike, support_z_m: float, count: int, rng: np.random.Generator) -> Completion:
    """The partial cloud with its mirror image in the horizontal plane half-way between its top and the support.

    The top is its highest point, whose image lies on the support. Half of the points are the partial cloud's, half
    are images, both thinned or repeated at random.

    Args:
        partial_m: (P, 3) metres, z up.
        support_z_m: height of the plane the object rests on.
        count: points in all.
        rng: random numbers.

    Returns:
        `count` points; no points at all without a partial cloud, and no hidden ones if all of it lies below the
        support.

    Raises:
        MeshError: the partial cloud has another shape or is not finite.
        RadarError: `support_z_m` is not finite.
    """
    partial = _checked(partial_m, support_z_m)
    if not (partial[:, 2] > support_z_m).any():
        return Completion(_drawn(partial, count, rng), np.empty((0, 3)))
    images = partial * [1, 1, -1] + [0, 0, partial[:, 2].max() + support_z_m]
    return Completion(_drawn(partial, count - count // 2, rng), _drawn(images, count // 2, rng))


def _checked(partial_m: ArrayLike, support_z_m: float) -> NDArray[np.float64]:
    if not np.isfinite(support_z_m):
        raise RadarError(f"support_z_m must be finite metres, got {support_z_m!r}")
    return finite_points("partial", partial_m)


def _drawn(points_m: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """`count` of the points at random, all equally often where they are too few; none of none."""
    if len(points_m) == 0:
        return np.empty((0, 3))
    return points_m[np.resize(rng.permutation(len(points_m)), count)]
