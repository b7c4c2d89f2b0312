"""The aperture cut into tiles: antenna groups over which an echo is smooth, with their nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.clusters import group_into_tiles
from waveformer.simulator.interpolation import chebyshev_points, lagrange_weights, points_for_phase
from waveformer.simulator.radar import Aperture

MAX_TILE_POSITIONS = 256
MAX_TILE_ANGLE_DEG = 12.0


@dataclass(frozen=True)
class Tile:
    """A compact group of TX-RX pairs and the nodes that stand for them.

    Attributes:
        rows: rows of the aperture, shape (n,).
        node_tx_m: transmitter positions of the nodes, shape (M, 3).
        node_rx_m: receiver positions, shape (M, 3); None when monostatic.
        weights: interpolation from nodes to rows, shape (n, M); None if every row is its own node.
        leaf: visibility leaf of every row, shape (n,).
        leaf_rows: the row that represents every leaf, shape (L,).
    """

    rows: NDArray[np.int64]
    node_tx_m: NDArray[np.float64]
    node_rx_m: NDArray[np.float64] | None
    weights: NDArray[np.float32] | None
    leaf: NDArray[np.int64]
    leaf_rows: NDArray[np.int64]

    def split(self, max_positions: int | None) -> list[Tile]:
        """Parts with at most `max_positions` rows that keep nodes and leaves, so the echo stays the same."""
        count = len(self.rows)
        if max_positions is None or count <= max_positions:
            return [self]
        parts = []
        weights = self.weights if self.weights is not None else np.eye(count, dtype=np.float32)
        for start in range(0, count, max_positions):
            piece = slice(start, start + max_positions)
            parts.append(replace(self, rows=self.rows[piece], leaf=self.leaf[piece], weights=weights[piece]))
        return parts


def build_tiles(
    aperture: Aperture,
    closest_m: float,
    cell_radius_m: float,
    wavelength_m: float,
    tolerance: float,
    leaf_spacing_m: float,
) -> list[Tile]:
    """Cut the aperture into tiles with interpolation nodes of bounded error.

    Args:
        aperture: N pairs.
        closest_m: smallest distance from any antenna to the surface.
        cell_radius_m: radius of the cells that the nodes must resolve.
        wavelength_m: shortest wavelength of the chirp.
        tolerance: see `Numerics`.
        leaf_spacing_m: extent of a visibility leaf.
    """
    centers = 0.5 * (aperture.tx_m + aperture.receivers_m)
    max_extent = closest_m * np.radians(MAX_TILE_ANGLE_DEG)
    # |d/dv (R_sample - R_cell centre)| <= radius / distance across the line of sight (both ways: 2 k)
    phase_per_metre = 4.0 * np.pi / wavelength_m * cell_radius_m / closest_m
    tiles = []
    for group, shift in _groups_of_equal_offset(aperture):
        for members in group_into_tiles(centers[group], MAX_TILE_POSITIONS, max_extent):
            rows = group[members]
            leaves = group_into_tiles(centers[rows], len(rows), leaf_spacing_m)
            leaf = np.empty(len(rows), dtype=np.int64)
            for index, leaf_members in enumerate(leaves):
                leaf[leaf_members] = index
            leaf_rows = rows[[_central(centers[rows], leaf_members) for leaf_members in leaves]]
            nodes, weights = _nodes(centers[rows], phase_per_metre, tolerance)
            receivers = None if aperture.rx_m is None else aperture.rx_m[rows]
            if weights is None or shift is None:
                tiles.append(Tile(rows, aperture.tx_m[rows], receivers, None, leaf, leaf_rows))
            else:
                receivers = None if receivers is None else nodes + 0.5 * shift
                tiles.append(Tile(rows, nodes - 0.5 * shift, receivers, weights, leaf, leaf_rows))
    return tiles


def _groups_of_equal_offset(
    aperture: Aperture,
) -> list[tuple[NDArray[np.int64], NDArray[np.float64] | None]]:
    """Rows that share one TX-RX offset, which may share nodes; None where no offset repeats."""
    if aperture.rx_m is None:
        return [(np.arange(len(aperture)), np.zeros(3))]
    offsets = np.round(aperture.rx_m - aperture.tx_m, 7)
    distinct, inverse = np.unique(offsets, axis=0, return_inverse=True)
    if len(distinct) * 16 > len(aperture):
        return [(np.arange(len(aperture)), None)]
    return [(np.flatnonzero(inverse.ravel() == i), offset) for i, offset in enumerate(distinct)]


def _central(positions: NDArray[np.float64], members: NDArray[np.int64]) -> int:
    """The member nearest to the middle of its group's bounding box."""
    group = positions[members]
    middle = 0.5 * (group.min(axis=0) + group.max(axis=0))
    return int(members[np.argmin(((group - middle) ** 2).sum(axis=1))])


def _nodes(
    positions: NDArray[np.float64], phase_per_metre: float, tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.float32] | None]:
    """Tensor-product Chebyshev nodes of a group's bounding box and the weights to its positions."""
    low, high = positions.min(axis=0), positions.max(axis=0)
    half, middle = 0.5 * (high - low), 0.5 * (high + low)
    counts = [points_for_phase(phase_per_metre * length, tolerance) if length > 0 else 1 for length in half]
    if np.prod(counts) >= len(positions):
        return positions, None
    axes, weights = [], np.ones((len(positions), 1))
    for axis, count in enumerate(counts):
        unit = chebyshev_points(count)
        axes.append(middle[axis] + half[axis] * unit)
        scaled = (positions[:, axis] - middle[axis]) / (half[axis] if half[axis] > 0 else 1.0)
        along = lagrange_weights(unit, scaled)
        weights = (weights[:, :, None] * along[:, None, :]).reshape(len(positions), -1)
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid, weights.astype(np.float32)


def probe_rows(aperture: Aperture, spacing_m: float) -> NDArray[np.int64]:
    """Rows that sample the aperture for a first look at visibility: group centres and the rim.

    Args:
        aperture: N pairs.
        spacing_m: largest extent of a group.

    Returns:
        Distinct rows, increasing.
    """
    centers = 0.5 * (aperture.tx_m + aperture.receivers_m)
    rows = [_central(centers, group) for group in group_into_tiles(centers, len(centers), spacing_m)]
    return np.unique([*rows, *corner_rows(centers)])


def corner_rows(centers: NDArray[np.float64]) -> NDArray[np.int64]:
    """Members of a group (n, 3) nearest to the corners and the middle of its bounding box."""
    low, high = centers.min(axis=0), centers.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    targets = np.concatenate([corners, 0.5 * (low + high)[None]])
    return np.unique([int(np.argmin(((centers - at) ** 2).sum(axis=1))) for at in targets])
