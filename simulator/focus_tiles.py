"""The aperture cut into sub-apertures for one block of cells, each with the few nodes that stand for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.clusters import group_into_tiles
from waveformer.simulator.radar import Aperture
from waveformer.simulator.subapertures import (
    groups_of_equal_offset,
    interpolation_nodes,
    node_phase_per_metre,
)

# Wider sub-apertures have fewer nodes in all but more of them for every antenna: the least work on a CPU lies here.
_MAX_ANGLE_RAD = 0.4


@dataclass(frozen=True)
class FocusTile:
    """A sub-aperture.

    Attributes:
        rows: of the aperture, shape (n,).
        nodes_m: transmitters, then receivers unless one place stands for both, each (M, 3).
        weights: interpolation from nodes to rows, shape (n, M); None if every row is its own node.
    """

    rows: NDArray[np.int64]
    nodes_m: list[NDArray[np.float64]]
    weights: NDArray[np.float32] | None


def focus_tiles(
    aperture: Aperture, closest_m: float, cell_radius_m: float, wavelength_m: float, tolerance: float
) -> list[FocusTile]:
    """Sub-apertures whose nodes resolve cells to the tolerance.

    Transmitter and receiver close to one another count as one antenna between them: their path to the centre of a cell
    is exact, and what the offset o changes within the cell, k |o|^2 radius / (4 distance^2), is below the tolerance.

    Args:
        aperture: N pairs.
        closest_m: smallest distance from an antenna to the voxels.
        cell_radius_m: of the cells.
        wavelength_m: shortest wavelength of the chirp.
        tolerance: error of the interpolation, relative to an antenna's contribution.
    """
    middles = 0.5 * (aperture.tx_m + aperture.receivers_m)
    offset_m = float(np.linalg.norm(aperture.receivers_m - aperture.tx_m, axis=1).max())
    phase_per_metre = node_phase_per_metre(closest_m, cell_radius_m, wavelength_m, 0.0)
    between = 2.0 * np.pi / wavelength_m * offset_m**2 * cell_radius_m / (4.0 * closest_m**2) <= tolerance
    if between:
        groups: list[tuple[NDArray[np.int64], NDArray[np.float64] | None]] = [
            (np.arange(len(aperture)), np.zeros(3))
        ]
    else:
        groups = groups_of_equal_offset(aperture)
    tiles = []
    for group, shift in groups:
        for members in group_into_tiles(middles[group], len(group), _MAX_ANGLE_RAD * closest_m):
            rows = group[members]
            nodes, weights = middles[rows], None
            if shift is not None:
                nodes, weights = interpolation_nodes(middles[rows], phase_per_metre, tolerance)
            if between:
                sides = [nodes]
            elif shift is None or weights is None:
                sides = [aperture.tx_m[rows], aperture.receivers_m[rows]]
            else:
                sides = [nodes - 0.5 * shift, nodes + 0.5 * shift]
            tiles.append(FocusTile(rows, sides, weights))
    return tiles
