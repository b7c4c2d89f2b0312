"""The aperture cut into tiles: antenna groups over which an echo is smooth, with their nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.clusters import group_by_lattice, group_into_tiles
from waveformer.simulator.interpolation import chebyshev_points, lagrange_weights, points_for_phase
from waveformer.simulator.radar import Aperture

MAX_TILE_POSITIONS = 256
MAX_TILE_ANGLE_DEG = 12.0
# Offsets between transmitter and receiver that differ by less are one offset.
_SAME_OFFSET_M = 1e-7


@dataclass(frozen=True)
class Tile:
    """A compact group of TX-RX pairs and the nodes that stand for them.

    Attributes:
        rows: rows of the aperture, shape (n,).
        node_tx_m: transmitter positions of the nodes, shape (M, 3).
        node_rx_m: receiver positions, shape (M, 3); None when monostatic.
        weights: interpolation from nodes to rows, shape (n, M); None if every row is its own node.
        ray_tx_m, ray_rx_m: positions from which visibility is traced, shape (L, 3); ray_rx_m None when
            monostatic.
        ray_weights: interpolation from them to the rows, shape (n, L).
        ray_shape: their lattice, odd along every axis, with product L; None if every row traces its own.
    """

    rows: NDArray[np.int64]
    node_tx_m: NDArray[np.float64]
    node_rx_m: NDArray[np.float64] | None
    weights: NDArray[np.float32] | None
    ray_tx_m: NDArray[np.float64]
    ray_rx_m: NDArray[np.float64] | None
    ray_weights: NDArray[np.float32]
    ray_shape: tuple[int, ...] | None

    @property
    def node_ray_weights(self) -> NDArray[np.float32]:
        """Interpolation from the lattice of ray positions to the nodes, shape (M, L)."""
        assert self.ray_shape is not None, "rows that stand alone have no lattice"
        low, side = self.ray_tx_m.min(axis=0), np.ptp(self.ray_tx_m, axis=0)
        return _multilinear(self.node_tx_m, low, side, self.ray_shape)

    def split(self, max_positions: int | None) -> list[Tile]:
        """Parts with at most `max_positions` rows that keep all nodes, so the echo stays the same."""
        count = len(self.rows)
        if max_positions is None or count <= max_positions:
            return [self]
        parts = []
        weights = self.weights if self.weights is not None else np.eye(count, dtype=np.float32)
        for start in range(0, count, max_positions):
            piece = slice(start, start + max_positions)
            parts.append(
                replace(
                    self, rows=self.rows[piece], weights=weights[piece], ray_weights=self.ray_weights[piece]
                )
            )
        return parts


def build_tiles(
    aperture: Aperture,
    closest_m: float,
    cell_radius_m: float,
    wavelength_m: float,
    tolerance: float,
    leaf_spacing_m: float,
    response_phase_per_radian: float = 0.0,
) -> list[Tile]:
    """Cut the aperture into tiles with interpolation nodes of bounded error.

    Args:
        aperture: N pairs.
        closest_m: smallest distance from any antenna to the surface.
        cell_radius_m: radius of the cells that the nodes must resolve.
        wavelength_m: shortest wavelength of the chirp.
        tolerance: see `Numerics`.
        leaf_spacing_m: pitch of the positions from which visibility is traced.
        response_phase_per_radian: how fast the phase of the response changes with the direction of a way.
    """
    centers = 0.5 * (aperture.tx_m + aperture.receivers_m)
    max_extent = closest_m * np.radians(MAX_TILE_ANGLE_DEG)
    phase_per_metre = node_phase_per_metre(closest_m, cell_radius_m, wavelength_m, response_phase_per_radian)
    tiles = []
    for group, shift in groups_of_equal_offset(aperture):
        for members in group_into_tiles(centers[group], MAX_TILE_POSITIONS, max_extent):
            rows = group[members]
            ray_tx, ray_rx = aperture.tx_m[rows], None if aperture.rx_m is None else aperture.rx_m[rows]
            ray_weights, ray_shape = np.eye(len(rows), dtype=np.float32), None
            if shift is not None:
                rays, ray_weights, ray_shape = _ray_positions(centers[rows], leaf_spacing_m)
                ray_tx, ray_rx = rays - 0.5 * shift, None if ray_rx is None else rays + 0.5 * shift
            nodes = _place_nodes(aperture, rows, shift, phase_per_metre, tolerance)
            tiles.append(Tile(rows, *nodes, ray_tx, ray_rx, ray_weights, ray_shape))
    return tiles


def node_phase_per_metre(
    closest_m: float, cell_radius_m: float, wavelength_m: float, response_phase_per_radian: float
) -> float:
    """How fast the echo of a cell, freed of its carrier, turns along the aperture; arguments as in `build_tiles`."""
    # |d/dv (R_sample - R_cell centre)| <= radius / distance across the line of sight (both ways: 2 k)
    return (4.0 * np.pi / wavelength_m * cell_radius_m + response_phase_per_radian) / closest_m


def move_nodes(tile: Tile, aperture: Aperture, phase_per_metre: float, tolerance: float) -> Tile:
    """The same group with nodes for where its antennas are now; what it sees stays.

    Args:
        tile: from `build_tiles`.
        aperture: antennas near those that the tile was built for.
        phase_per_metre, tolerance: see `node_phase_per_metre` and `build_tiles`.
    """
    offsets = (aperture.receivers_m - aperture.tx_m)[tile.rows]
    shift = offsets.mean(axis=0)
    shared = tile.ray_shape is not None and bool(np.abs(offsets - shift).max() < _SAME_OFFSET_M)
    tx, rx, weights = _place_nodes(aperture, tile.rows, shift if shared else None, phase_per_metre, tolerance)
    return replace(tile, node_tx_m=tx, node_rx_m=rx, weights=weights)


def _place_nodes(
    aperture: Aperture,
    rows: NDArray[np.int64],
    shift: NDArray[np.float64] | None,
    phase_per_metre: float,
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, NDArray[np.float32] | None]:
    """Transmitters and receivers of the nodes of a group, and the weights; without a shift rows are their own nodes."""
    tx, rx = aperture.tx_m[rows], None if aperture.rx_m is None else aperture.rx_m[rows]
    if shift is None:
        return tx, rx, None
    nodes, weights = interpolation_nodes(tx + 0.5 * shift, phase_per_metre, tolerance)
    if weights is None:
        return tx, rx, None
    return nodes - 0.5 * shift, None if rx is None else nodes + 0.5 * shift, weights


def groups_of_equal_offset(
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


def interpolation_nodes(
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


def _ray_positions(
    positions: NDArray[np.float64], spacing_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float32], tuple[int, ...] | None]:
    """A lattice over a group's bounding box, multilinear weights to its positions, and the lattice's shape.

    Linear interpolation keeps the mean position of a shadow edge right for every antenna; the nearest
    lattice point would move it by up to half a spacing.
    """
    low, side = positions.min(axis=0), np.ptp(positions, axis=0)
    axes = []
    for axis in range(positions.shape[1]):
        # odd, so that every second point spans the box; a thin box needs no second layer
        count = (
            2 * int(np.ceil(0.5 * side[axis] / spacing_m - 1e-9)) + 1 if side[axis] > 0.25 * spacing_m else 1
        )
        axes.append(low[axis] + side[axis] * (np.linspace(0.0, 1.0, count) if count > 1 else np.array([0.5])))
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    shape = tuple(len(axis) for axis in axes)
    return lattice, _multilinear(positions, low, side, shape), shape


def _multilinear(
    positions: NDArray[np.float64],
    low: NDArray[np.float64],
    side: NDArray[np.float64],
    shape: tuple[int, ...],
) -> NDArray[np.float32]:
    """Weights (n, L) from a lattice over a box to positions inside it."""
    weights = np.ones((len(positions), 1))
    for axis, count in enumerate(shape):
        scaled = (positions[:, axis] - low[axis]) / (side[axis] if count > 1 else 1.0) * (count - 1)
        along = np.maximum(0.0, 1.0 - np.abs(scaled[:, None] - np.arange(count)))
        weights = (weights[:, :, None] * along[:, None, :]).reshape(len(positions), -1)
    return weights.astype(np.float32)


def probe_rows(aperture: Aperture, spacing_m: float) -> NDArray[np.int64]:
    """Rows that sample the aperture for a first look at visibility: group centres and the rim.

    Args:
        aperture: N pairs.
        spacing_m: largest extent of a group.

    Returns:
        Distinct rows, increasing.
    """
    centers = 0.5 * (aperture.tx_m + aperture.receivers_m)
    group = group_by_lattice(centers, spacing_m)
    rows = [_central(centers, np.flatnonzero(group == i)) for i in range(group.max() + 1)]
    return np.unique([*rows, *corner_rows(centers)])


def corner_rows(centers: NDArray[np.float64]) -> NDArray[np.int64]:
    """Members of a group (n, 3) nearest to the corners and the middle of its bounding box."""
    low, high = centers.min(axis=0), centers.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    targets = np.concatenate([corners, 0.5 * (low + high)[None]])
    return np.unique([int(np.argmin(((centers - at) ** 2).sum(axis=1))) for at in targets])
