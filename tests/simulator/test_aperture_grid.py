"""Regular grids among antenna positions."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.aperture_grid import ApertureGrid
from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import Aperture

GRID = Aperture.planar_grid(9, 12, (0.003, 0.0041), center_m=(0.1, -0.2, 0.05)).tx_m


def test_a_planar_grid_is_found_as_it_was_made() -> None:
    np.testing.assert_array_equal(ApertureGrid.find(GRID, 8).rows, np.arange(108).reshape(12, 9))


def test_the_order_of_the_positions_does_not_matter(rng: np.random.Generator) -> None:
    order = rng.permutation(len(GRID))
    rows = ApertureGrid.find(GRID[order], 8).rows
    np.testing.assert_array_equal(order[rows], np.arange(108).reshape(12, 9))


def test_a_raster_scan_is_a_grid_back_and_forth() -> None:
    scan = Aperture.raster_rows(0.03, 9, step_m=0.003, row_spacing_m=0.004).tx_m
    rows = ApertureGrid.find(scan, 8).rows
    np.testing.assert_array_equal(rows[1], np.arange(11)[::-1] + 11)


def test_jitter_of_a_micrometre_is_no_harm(rng: np.random.Generator) -> None:
    moved = GRID + rng.uniform(-1e-6, 1e-6, GRID.shape)
    np.testing.assert_array_equal(ApertureGrid.find(moved, 8).rows, np.arange(108).reshape(12, 9))


def irregular(rng: np.random.Generator) -> dict[str, np.ndarray]:
    bent, tilted, uneven = GRID.copy(), GRID.copy(), GRID.copy()
    bent[:, 2] += 0.1 * GRID[:, 0] ** 2
    tilted[:, 0] += 0.1 * GRID[:, 1]
    uneven[uneven[:, 0] == uneven[:, 0].max(), 0] += 0.001
    return {
        "random": rng.normal(size=(100, 3)),
        "a hole": np.delete(GRID, 40, axis=0),
        "a repeated place": np.concatenate([GRID[:-1], GRID[:1]]),
        "bent": bent,
        "sheared": tilted,
        "uneven": uneven,
        "one place": np.zeros((1, 3)),
    }


@pytest.mark.parametrize(
    "kind", ["random", "a hole", "a repeated place", "bent", "sheared", "uneven", "one place"]
)
def test_other_apertures_are_refused(rng: np.random.Generator, kind: str) -> None:
    with pytest.raises(RadarError, match=r"tx_m .*grid"):
        ApertureGrid.find(irregular(rng)[kind], 8)


def test_a_small_grid_is_refused() -> None:
    with pytest.raises(RadarError, match="9 x 12 positions, and at least 10 x 10"):
        ApertureGrid.find(GRID, 10)


@pytest.mark.parametrize(
    ("per_axis", "shape"), [(20, (20, 20)), (30, (30, 30)), (60, (60, 60)), (80, (60, 60))]
)
def test_thinning_keeps_as_many_as_asked_for(per_axis: int, shape: tuple[int, int]) -> None:
    grid = ApertureGrid.find(Aperture.planar_grid(60, 60, 0.004).tx_m, 8).thinned(per_axis)
    assert grid.rows.shape == shape


def test_tiles_are_blocks_of_the_grid() -> None:
    labels = ApertureGrid.find(GRID, 8).tile_labels(3).reshape(12, 9)
    np.testing.assert_array_equal(labels[::4, ::3], np.arange(9).reshape(3, 3))
    assert set(np.bincount(labels.ravel())) == {12}
