"""The separate reflections of a mask: 6-connected components of a physical size."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.model.voxels import voxel_edges_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

# mmNorm's limits, which it states in voxels of 1 mm; the second one counts where nothing passes the first.
MINIMUM_VOLUME_M3 = 0.03 * 0.03 * 0.04
FALLBACK_VOLUME_M3 = 0.015 * 0.015 * 0.02
# mmNorm's order, which decides through which neighbour a voxel is reached first.
NEIGHBOURS = np.array([(-1, 0, 0), (0, 1, 0), (1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])


def connected_components(
    mask: NDArray[np.bool_],
    grid: Grid,
    *,
    minimum_volume_m3: float = MINIMUM_VOLUME_M3,
    fallback_volume_m3: float = FALLBACK_VOLUME_M3,
) -> list[NDArray[np.int64]]:
    """Voxels of every 6-connected component larger than a volume.

    Args:
        mask: shape (X, Y, Z).
        grid: its voxels, evenly spaced along each axis.
        minimum_volume_m3: a component must be larger.
        fallback_volume_m3: the limit where no component passes the first.

    Returns:
        One array of voxels (i, j, k) per component, shape (V, 3), in C order; largest component first, those
        of one size in C order of their first voxel. Empty if no component passes either limit.

    Raises:
        RadarError: the mask does not fit the grid, or the grid is not regular.
    """
    from scipy import ndimage

    inside = np.asarray(mask, dtype=bool)
    if inside.shape != grid.shape:
        raise RadarError(f"mask of shape {inside.shape} does not fit the grid {grid.shape}")
    if not inside.any():
        return []
    volume_m3 = float(np.prod(voxel_edges_m(grid)))
    labels, count = ndimage.label(inside)
    index = np.argwhere(inside)
    label_of = labels[inside]
    sizes = np.bincount(label_of, minlength=count + 1)
    order = np.argsort(-sizes[1:], kind="stable") + 1
    # By label, C order kept within each.
    by_label = np.split(index[np.argsort(label_of, kind="stable")], np.cumsum(sizes[1:-1]))
    for limit_m3 in (minimum_volume_m3, fallback_volume_m3):
        # Edges carry rounding errors: a component of exactly the limit must not pass by one.
        kept = [by_label[label - 1] for label in order if sizes[label] * volume_m3 > limit_m3 * (1 + 1e-9)]
        if kept:
            return kept
    return []


def neighbour_table(component: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row of every voxel's neighbours in the order of `NEIGHBOURS`, V where there is none, shape (V, 6)."""
    low = component.min(axis=0) - 1
    shape = component.max(axis=0) - low + 2
    rows = np.full(shape, len(component), dtype=np.int64)
    local = component - low
    rows[tuple(local.T)] = np.arange(len(component))
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    flat = local @ strides
    return np.asarray(rows.reshape(-1)[flat[:, None] + NEIGHBOURS @ strides])
