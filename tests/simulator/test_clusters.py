"""Groups of samples and of antenna positions: partitions with bounded extents, the same every time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waveformer.simulator.clusters import group_by_lattice, group_into_cells, group_into_tiles


def cloud(seed: int, count: int, dimensions: int = 3) -> np.ndarray:
    """Random points, some coinciding, some axes without extent."""
    generator = np.random.default_rng(seed)
    points = generator.uniform(-0.2, 0.2, (count, dimensions)) * generator.choice([0, 1, 1, 1], dimensions)
    points[generator.integers(count, size=count // 3)] = points[0]
    return points


CLOUDS = st.builds(cloud, st.integers(0, 10_000), st.integers(1, 300))


@settings(max_examples=50, deadline=None)
@given(CLOUDS, st.sampled_from([0.003, 0.05, 1.0]))
def test_cells_hold_every_sample_once_and_never_exceed_their_edge(points: np.ndarray, edge_m: float) -> None:
    cells = group_into_cells(points, edge_m)
    assert sorted(cells.order) == list(range(len(points)))
    assert cells.starts[0] == 0
    assert cells.starts[-1] == len(points)
    assert (np.diff(cells.starts) > 0).all()
    assert len(cells) == len(cells.starts) - 1
    farthest = 0.0
    for cell, center in enumerate(cells.centers_m):
        members = cells.order[cells.starts[cell] : cells.starts[cell + 1]]
        assert (np.diff(members) > 0).all()  # the order within a cell is kept
        low, high = points[members].min(axis=0), points[members].max(axis=0)
        assert ((high - low) <= edge_m * (1 + 1e-9)).all()  # rounding of the lattice coordinate
        assert center == pytest.approx(0.5 * (low + high), abs=1e-15)
        farthest = max(farthest, float(np.linalg.norm(points[members] - center, axis=1).max()))
    assert cells.radius_m == pytest.approx(farthest, abs=1e-15)
    assert cells.radius_m <= 0.5 * np.sqrt(3) * edge_m * (1 + 1e-9)


def test_samples_in_one_cube_share_a_cell_and_neighbours_do_not() -> None:
    points = np.array([[0.0, 0, 0], [0.99, 0.99, 0.99], [1.01, 0, 0], [0, 0, 2.5]])
    cells = group_into_cells(points, 1.0)
    assert len(cells) == 3
    assert set(cells.order[: cells.starts[1]]) == {0, 1}


@settings(max_examples=50, deadline=None)
@given(CLOUDS, st.sampled_from([1, 7, 100]), st.sampled_from([0.01, 0.1, 10.0]))
def test_tiles_hold_every_position_once_within_count_and_extent(
    positions: np.ndarray, max_count: int, max_extent_m: float
) -> None:
    tiles = group_into_tiles(positions, max_count, max_extent_m)
    assert sorted(np.concatenate(tiles)) == list(range(len(positions)))
    for members in tiles:
        assert 1 <= len(members) <= max_count
        assert (np.ptp(positions[members], axis=0) <= max_extent_m).all()
        assert (np.diff(members) > 0).all()


def test_tiles_split_only_when_they_must() -> None:
    positions = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0)), axis=-1).reshape(-1, 2)
    assert len(group_into_tiles(positions, 64, 7.0)) == 1
    assert len(group_into_tiles(positions, 32, 7.0)) == 2
    assert len(group_into_tiles(positions, 64, 3.0)) == 4


@settings(max_examples=50, deadline=None)
@given(CLOUDS, st.sampled_from([0.01, 0.1, 10.0]))
def test_lattice_groups_are_numbered_without_gaps_and_bounded(positions: np.ndarray, spacing: float) -> None:
    group = group_by_lattice(positions, spacing)
    assert group.shape == (len(positions),)
    assert set(group) == set(range(group.max() + 1))
    for number in range(group.max() + 1):
        assert (np.ptp(positions[group == number], axis=0) <= spacing * (1 + 1e-6)).all()  # rounding


def test_equal_input_gives_equal_groups(rng: np.random.Generator) -> None:
    points = rng.uniform(size=(500, 3))
    first, second = (group_into_cells(points.copy(), 0.2) for _ in range(2))
    assert (first.order == second.order).all()
    assert (first.centers_m == second.centers_m).all()
    for one, other in zip(*(group_into_tiles(points.copy(), 9, 0.3) for _ in range(2)), strict=True):
        assert (one == other).all()


def test_positions_that_all_coincide_are_still_cut_to_the_count() -> None:
    tiles = group_into_tiles(np.zeros((10, 3)), 4, 1.0)
    assert max(len(members) for members in tiles) <= 4
    assert group_by_lattice(np.zeros((10, 3)), 0.1).max() == 0
