"""Surface normals of voxels: where they exist, those of a component or of a potential, and their errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.model.components import neighbour_table
from waveformer.model.voxels import voxel_edges_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid


def has_normal(normals: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Voxels whose normal was computed and is not zero, shape (X, Y, Z).

    Args:
        normals: shape (X, Y, Z, 3), NaN where not computed.
    """
    squared = np.einsum("...i,...i->...", normals, normals)
    return np.asarray(np.isfinite(squared) & (squared > 0))


def component_normals(normals: NDArray[np.floating], component: NDArray[np.int64]) -> NDArray[np.float64]:
    """Normals of the voxels of a component, of unit length, shape (V, 3).

    Args:
        normals: shape (X, Y, Z, 3), pointing to the radar.
        component: voxels (i, j, k), shape (V, 3).

    Raises:
        RadarError: the component is empty, not within the field, or has voxels without a normal.
    """
    if component.ndim != 2 or component.shape[1] != 3 or len(component) == 0:
        raise RadarError(f"a component must be voxels of shape (V, 3) with V >= 1, got {component.shape}")
    if normals.ndim != 4 or normals.shape[3] != 3:
        raise RadarError(f"normals must have shape (X, Y, Z, 3), got {normals.shape}")
    if (component < 0).any() or (component >= normals.shape[:3]).any():
        raise RadarError(f"the component reaches beyond the normals of shape {normals.shape}")
    inside = normals[tuple(component.T)].astype(np.float64)
    length = np.linalg.norm(inside, axis=1)
    missing = int((~(np.isfinite(length) & (length > 0))).sum())
    if missing:
        raise RadarError(f"{missing} of {len(component)} voxels have no normal: leave them out of the mask")
    return np.asarray(inside / length[:, None])


def gradient_normals(
    potential_m: NDArray[np.float64], component: NDArray[np.int64], grid: Grid
) -> NDArray[np.float64]:
    """Unit vectors along the gradient of a potential, shape (V, 3).

    Differences are central where both neighbours belong to the component, else one-sided; a voxel without a
    gradient points up.

    Args:
        potential_m: shape (V,).
        component: voxels (i, j, k), shape (V, 3).
        grid: the voxels, evenly spaced along each axis.
    """
    edges = voxel_edges_m(grid)
    neighbours = neighbour_table(component)
    size = len(component)
    itself = np.arange(size)
    gradient = np.zeros((size, 3))
    # Columns of the table that hold the neighbours behind and ahead along x, y and z.
    for axis, (behind, ahead) in enumerate(((0, 2), (3, 1), (5, 4))):
        before, after = neighbours[:, behind], neighbours[:, ahead]
        steps = (before < size).astype(np.int64) + (after < size)
        rise = potential_m[np.where(after < size, after, itself)]
        rise = rise - potential_m[np.where(before < size, before, itself)]
        gradient[:, axis] = rise / (edges[axis] * np.maximum(steps, 1))
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    gradient[length[:, 0] == 0] = (0.0, 0.0, 1.0)
    return np.asarray(gradient / np.where(length > 0, length, 1.0))


def angular_error_deg(normals: ArrayLike, truth: ArrayLike) -> NDArray[np.float64]:
    """Angle between vectors of any length, degrees, shape (...).

    Args:
        normals, truth: shape (..., 3).
    """
    first, second = np.asarray(normals, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    along = np.einsum("...i,...i->...", first, second)
    return np.asarray(np.degrees(np.arctan2(across, along)))
