"""The level of a field that lies nearest to the ground truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from waveformer.simulator.errors import RadarError


def reference_level(
    potential_m: ArrayLike, distance_m: ArrayLike, levels_m: ArrayLike, delta_m: float
) -> int:
    """The level of a field that is nearest to the mesh: least median |signed distance| of its voxels.

    Args:
        potential_m: field f at the voxels of a component, (V,).
        distance_m: signed distance of the same voxels to the mesh, (V,): one query serves all levels.
        levels_m: (L,).
        delta_m: a voxel belongs to a level if |f - level| is less than this (Eq. 6 of the paper).

    Returns:
        Index of the level; of equal ones the first.

    Raises:
        RadarError: no voxel belongs to any level, or the sizes disagree.
    """
    potential, distance, levels = (
        np.asarray(values, dtype=np.float64) for values in (potential_m, distance_m, levels_m)
    )
    if potential.shape != distance.shape:
        raise RadarError(f"{potential.size} potentials for {distance.size} distances")
    medians = np.full(len(levels), np.inf)
    for index, level in enumerate(levels):
        near = np.abs(potential - level) < delta_m
        if near.any():
            medians[index] = np.median(np.abs(distance[near]))
    if not np.isfinite(medians).any():
        raise RadarError(f"none of {len(levels)} levels has a voxel within {delta_m:g} m")
    return int(medians.argmin())
