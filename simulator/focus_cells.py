"""A voxel grid cut into blocks of equal cells, and the cells into columns of equally many voxels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.grid import Grid

# Voxels of a column: more keep more sums than a core has registers.
_MAX_COLUMN = 4
CELLS_PER_BLOCK_EDGE = 16


@dataclass(frozen=True, eq=False)
class FocusCells:
    """The cells of one block that are wanted, as columns of voxels.

    Cells at the far ends of the grid are as large as all others; what lies beyond the grid is dropped.

    Attributes:
        centers_m: shape (Q, 3).
        radius_m: largest distance of a voxel from its cell's centre.
        cell: cell of every column, shape (C,).
        x_m, y_m: offsets of the columns from the centres, shape (C,).
        z_m: offsets of their voxels, shape (L, C).
        voxels: index of every voxel in the grid, C order, shape (L, C); -1 beyond the grid.
    """

    centers_m: NDArray[np.float64]
    radius_m: float
    cell: NDArray[np.int64]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    voxels: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Runs:
    """One axis in runs of equally many voxels; the last run goes on beyond the axis.

    Attributes:
        index: voxel of every place of every run, shape (runs, length); beyond the axis -1.
        offsets_m: of the places from the middle of their run, same shape.
        middles_m: shape (runs,).
    """

    index: NDArray[np.int64]
    offsets_m: NDArray[np.float64]
    middles_m: NDArray[np.float64]


def focus_cells(
    grid: Grid,
    edge_m: float,
    where: NDArray[np.bool_] | None = None,
    cells_per_edge: int = CELLS_PER_BLOCK_EDGE,
) -> Iterator[FocusCells]:
    """Cut a grid into blocks of cells up to `edge_m` wide.

    Args:
        grid: voxels.
        edge_m: largest extent of a cell between the centres of its outer voxels.
        where: voxels that are wanted, shape (X, Y, Z); cells without any are left out. None wants all.
        cells_per_edge: cells along each edge of a block.
    """
    runs = [_runs(axis, edge_m, is_column=place == 2) for place, axis in enumerate((grid.x, grid.y, grid.z))]
    wanted = _wanted_cells(runs, where)
    starts = [range(0, len(run.middles_m), cells_per_edge) for run in runs]
    for start in product(*starts):
        block = wanted[tuple(slice(first, first + cells_per_edge) for first in start)]
        cells = np.argwhere(block) + np.array(start)
        if len(cells):
            yield _block(grid, runs, cells)


def _runs(axis: NDArray[np.float64], edge_m: float, is_column: bool) -> _Runs:
    step = float(np.ptp(axis)) / (len(axis) - 1) if len(axis) > 1 else edge_m
    longest = min(len(axis), int(edge_m / step + 1e-9) + 1)
    length = -(-len(axis) // -(-len(axis) // longest))  # as even as the number of runs allows
    if is_column and length > _MAX_COLUMN:
        # equal columns, no longer together than a cell may be
        pieces = -(-length // _MAX_COLUMN)
        length = min(pieces * -(-length // pieces), longest // pieces * pieces)
    count = -(-len(axis) // length)
    beyond = axis[-1] + step * np.arange(1, count * length - len(axis) + 1)
    places = np.concatenate([axis, beyond]).reshape(count, length)
    middles = 0.5 * (places[:, 0] + places[:, -1])
    index = np.arange(count * length)
    index[len(axis) :] = -1
    return _Runs(index.reshape(count, length), places - middles[:, None], middles)


def _wanted_cells(runs: list[_Runs], where: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
    if where is None:
        return np.ones([len(run.middles_m) for run in runs], dtype=bool)
    wanted = where
    for place, run in enumerate(runs):
        first = np.where(run.index[:, 0] < 0, 0, run.index[:, 0])
        wanted = np.logical_or.reduceat(wanted, first, axis=place)
    return wanted


def _block(grid: Grid, runs: list[_Runs], cells: NDArray[np.int64]) -> FocusCells:
    middles = np.stack([run.middles_m[cells[:, place]] for place, run in enumerate(runs)], axis=1)
    x, y, z = (run.offsets_m[cells[:, place]] for place, run in enumerate(runs))  # (Q, length) each
    at_x, at_y, at_z = (run.index[cells[:, place]] for place, run in enumerate(runs))
    length = z.shape[1]
    pieces = -(-length // _MAX_COLUMN)
    shape = (len(cells), x.shape[1], y.shape[1], pieces)
    across = np.broadcast_to(x[:, :, None, None], shape), np.broadcast_to(y[:, None, :, None], shape)
    along = z.reshape(len(cells), 1, 1, pieces, -1)
    inside = (at_x[:, :, None] >= 0) & (at_y[:, None, :] >= 0)
    _, num_y, num_z = grid.shape
    flat = (at_x[:, :, None] * num_y + at_y[:, None, :])[:, :, :, None, None] * num_z + at_z.reshape(
        along.shape
    )
    kept = inside[:, :, :, None, None] & (at_z.reshape(along.shape) >= 0)
    columns = (*shape, along.shape[-1])
    return FocusCells(
        centers_m=middles,
        radius_m=float(np.sqrt(max((x**2).max(axis=1) + (y**2).max(axis=1) + (z**2).max(axis=1)))),
        cell=np.repeat(np.arange(len(cells)), int(np.prod(shape[1:]))),
        x_m=across[0].reshape(-1),
        y_m=across[1].reshape(-1),
        z_m=np.broadcast_to(along, columns).reshape(-1, columns[-1]).T,
        voxels=np.where(kept, flat, -1).reshape(-1, columns[-1]).T,
    )
