"""Compact groups: surface samples into cells, antenna positions into tiles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Cells:
    """Surface samples sorted into the occupied cubes of a regular lattice.

    Attributes:
        order: sample indices, cell by cell, shape (S,).
        starts: first entry of every cell in `order`, shape (Q + 1,).
        centers_m: middle of the bounding box of every cell's samples, shape (Q, 3).
        radius_m: largest distance of a sample from its cell's centre.
    """

    order: NDArray[np.int64]
    starts: NDArray[np.int64]
    centers_m: NDArray[np.float64]
    radius_m: float

    def __len__(self) -> int:
        return len(self.centers_m)


def group_into_cells(points_m: NDArray[np.float64], edge_m: float) -> Cells:
    """Sort points (S, 3) into lattice cubes of the given edge; the order within a cell is kept."""
    lattice = np.floor((points_m - points_m.min(axis=0)) / edge_m).astype(np.int64)
    extent = lattice.max(axis=0) + 1
    key = (lattice[:, 0] * extent[1] + lattice[:, 1]) * extent[2] + lattice[:, 2]
    order = np.argsort(key, kind="stable")
    sorted_key = key[order]
    starts = np.flatnonzero(np.concatenate([[True], np.diff(sorted_key) != 0]))
    starts = np.append(starts, len(order))
    return Cells(order, starts, *cell_bounds(points_m[order], starts))


def cell_bounds(
    points_m: NDArray[np.float64], starts: NDArray[np.int64]
) -> tuple[NDArray[np.float64], float]:
    """Centres (Q, 3) and largest radius of runs of points (S, 3) that begin at `starts` (Q + 1,)."""
    low = np.minimum.reduceat(points_m, starts[:-1], axis=0)
    high = np.maximum.reduceat(points_m, starts[:-1], axis=0)
    centers = 0.5 * (low + high)
    offsets = points_m - np.repeat(centers, np.diff(starts), axis=0)
    return centers, float(np.sqrt(np.einsum("ij,ij->i", offsets, offsets).max()))


def group_by_lattice(positions: NDArray[np.float64], spacing: float) -> NDArray[np.int64]:
    """Number the occupied cells of the coarsest lattice over positions (N, D) with cells up to `spacing`.

    Returns:
        Cell number of every position, 0 .. number of occupied cells - 1, shape (N,).
    """
    low, side = positions.min(axis=0), np.ptp(positions, axis=0)
    counts = np.maximum(1, np.ceil(side / spacing - 1e-9)).astype(np.int64)
    scaled = (positions - low) / np.where(side > 0, side, 1.0) * counts
    lattice = np.minimum(scaled.astype(np.int64), counts - 1)
    return np.asarray(
        np.unique(np.ravel_multi_index(tuple(lattice.T), tuple(counts)), return_inverse=True)[1]
    )


def group_into_tiles(
    positions: NDArray[np.float64], max_count: int, max_extent_m: float
) -> list[NDArray[np.int64]]:
    """Split positions (N, D) along their longest side until groups are small and compact.

    A group holds at most `max_count` positions and no side of its bounding box exceeds
    `max_extent_m`. The split is the exact median in a stable order, so equal inputs give equal tiles.

    Returns:
        Index arrays, which together hold every position once.
    """
    tiles: list[NDArray[np.int64]] = []
    pending = [np.arange(len(positions))]
    while pending:
        members = pending.pop()
        side = np.ptp(positions[members], axis=0)
        axis = int(side.argmax())
        if len(members) == 1 or (len(members) <= max_count and side[axis] <= max_extent_m):
            tiles.append(np.sort(members))
            continue
        ranked = members[np.argsort(positions[members, axis], kind="stable")]
        middle = len(ranked) // 2
        pending += [ranked[middle:], ranked[:middle]]
    return tiles
