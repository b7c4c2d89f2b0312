"""Swept walls of the smallest clouds, counted by hand."""

import numpy as np
import pytest

from waveformer.eval.swept_walls import Columns


def test_one_column():
    columns = Columns.of_cloud(np.array([(0.5, 0.5, 3.0), (0.6, 0.7, 2.0)]), 0.0, 1.0)
    assert columns.footprint_m2 == 1
    swept = columns.walls_and_floor()
    assert swept.areas_m2.tolist() == [1, 2, 2, 2, 2]
    assert columns.occupied.sum() == 1 and columns.height_m.max() == 2


def test_two_columns_share_no_wall():
    columns = Columns.of_cloud(np.array([(0.0, 0.0, 1.0), (1.0, 0.0, 3.0)]), 0.0, 1.0)
    areas = columns.walls_and_floor().areas_m2
    assert sorted(areas) == [1, 1, 1, 1, 1, 3, 3, 3]


def test_walls_stand_around_the_floor(rng):
    swept = Columns.of_cloud(np.array([(0.0, 0.0, 1.0)]), -1.0, 1.0).walls_and_floor()
    points = swept.sample(2000, rng)
    on_floor = points[:, 2] == -1
    at_edge = (np.abs(points[:, :2] - 0.5) == 0.5).any(axis=1)
    assert (on_floor | at_edge).all()
    assert points.min(axis=0) == pytest.approx([0, 0, -1], abs=0.01)
    assert points.max(axis=0) == pytest.approx([1, 1, 1], abs=0.01)


def test_no_wall_below_the_plane():
    columns = Columns.of_cloud(np.array([(0.0, 0.0, -1.0), (1.0, 0.0, 2.0)]), 0.0, 1.0)
    areas = columns.walls_and_floor().areas_m2
    assert sorted(areas) == [0, 0, 0, 1, 1, 2, 2, 2]
