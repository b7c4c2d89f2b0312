"""Grids cut into cells and columns: every voxel once, where it belongs."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator import Grid
from waveformer.simulator.focus_cells import focus_cells

GRIDS = {
    "regular": Grid.box((0.0, 0.0, -0.3), (0.05, 0.031, -0.24), 0.003),
    "fine": Grid.box((0.0, 0.0, -0.3), (0.004, 0.004, -0.28), 0.0005),
    "one voxel": Grid(np.zeros(1), np.zeros(1), np.zeros(1)),
    "uneven": Grid(np.array([0.0, 0.001, 0.02]), np.arange(7) * 0.01, np.array([-0.4, -0.3, -0.29, -0.28])),
}


@pytest.mark.parametrize("cells_per_edge", [1, 3, 16])
@pytest.mark.parametrize("name", GRIDS)
def test_every_voxel_is_in_one_column_at_its_place(name: str, cells_per_edge: int) -> None:
    grid = GRIDS[name]
    points = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1).reshape(-1, 3)
    times = np.zeros(len(points), dtype=int)
    for cells in focus_cells(grid, 0.012, cells_per_edge=cells_per_edge):
        length = len(cells.z_m)
        x, y = np.broadcast_to(cells.x_m, cells.z_m.shape), np.broadcast_to(cells.y_m, cells.z_m.shape)
        offsets = np.stack([x, y, cells.z_m], axis=-1)
        places = cells.centers_m[cells.cell] + offsets
        inside = cells.voxels >= 0
        assert np.abs(places[inside] - points[cells.voxels[inside]]).max() < 1e-12
        assert np.linalg.norm(offsets, axis=-1).max() <= cells.radius_m + 1e-12
        times += np.bincount(cells.voxels[inside], minlength=len(points))
        assert length <= 4
    assert (times == 1).all()


def test_cells_keep_to_their_edge() -> None:
    for cells in focus_cells(GRIDS["regular"], 0.012):
        assert max(np.abs(cells.x_m).max(), np.abs(cells.y_m).max(), np.abs(cells.z_m).max()) <= 0.006 + 1e-12


def test_only_cells_with_wanted_voxels() -> None:
    grid = GRIDS["regular"]
    where = np.zeros(grid.shape, dtype=bool)
    where[0, 0, 0] = where[-1, -1, -1] = True
    (block,) = focus_cells(grid, 0.012, where)
    assert len(block.centers_m) == 2
    assert {0, where.size - 1} <= set(block.voxels.reshape(-1).tolist())
    assert not list(focus_cells(grid, 0.012, np.zeros(grid.shape, dtype=bool)))
