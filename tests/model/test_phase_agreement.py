"""Agreement of residual phases: neighbours found, and what noise, rows and drifts do to it."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.model.phase_agreement import (
    block_agreement,
    neighbour_rows,
    pair_agreement,
    profile_correlation,
)
from waveformer.simulator.arrays import with_receivers
from waveformer.simulator.radar import Aperture

APERTURE = Aperture.planar_grid(31, 41, 0.01)
CENTERS = APERTURE.tx_m


def agreements(correlation: np.ndarray, rows: np.ndarray) -> list[float]:
    return [pair_agreement(correlation[a], correlation[b]) for a, b in neighbour_rows(CENTERS, rows)]


def test_correlation_by_hand() -> None:
    measured = np.array([[1.0, 1.0j], [1.0, 0.0], [0.0, 0.0]])
    simulated = np.array([[2.0j, -2.0], [1.0, 1.0], [1.0, 1.0]])
    assert profile_correlation(measured, simulated) == pytest.approx([-1j, np.sqrt(0.5), 0.0])


def test_neighbours_on_a_grid_lie_one_pitch_away_along_each_axis(rng: np.random.Generator) -> None:
    rows = np.sort(rng.choice(len(CENTERS), 100, replace=False))
    (x_rows, x_next), (y_rows, y_next) = neighbour_rows(CENTERS, rows)
    assert ((x_rows == rows) | (x_next == rows)).all()
    assert ((y_rows == rows) | (y_next == rows)).all()
    assert CENTERS[x_next] - CENTERS[x_rows] == pytest.approx(np.tile([0.01, 0, 0], (100, 1)))
    assert CENTERS[y_next] - CENTERS[y_rows] == pytest.approx(np.tile([0, 0.01, 0], (100, 1)))


def test_neighbours_across_the_rows_of_a_receiver_array() -> None:
    pairs = with_receivers(Aperture.planar_grid(20, 20, 0.004), "mito")
    centers = 0.5 * (pairs.tx_m + pairs.receivers_m)
    (_, _), (rows, neighbours) = neighbour_rows(centers, np.arange(len(pairs)))
    step = np.abs(centers[rows] - centers[neighbours])
    assert len(rows) == len(pairs)
    assert step[:, 1] == pytest.approx(np.full(len(pairs), 0.004))
    assert step[:, 0].max() < 1e-9


def test_apertures_without_a_neighbour() -> None:
    line = Aperture.planar_grid(10, 1, 0.01).tx_m
    assert len(neighbour_rows(line, np.arange(10))) == 1
    assert neighbour_rows(line[:1], np.arange(1)) == []


def test_a_perfect_fit_with_any_common_phase_and_slope_agrees(rng: np.random.Generator) -> None:
    rows = np.sort(rng.choice(len(CENTERS), 200, replace=False))
    steady = np.full(len(CENTERS), np.exp(0.7j))
    assert agreements(steady, rows) == pytest.approx([1.0, 1.0])
    assert block_agreement(steady[rows], CENTERS[rows]) == pytest.approx(1.0)


def test_random_phases_do_not(rng: np.random.Generator) -> None:
    noise = np.exp(2j * np.pi * rng.random(len(CENTERS)))
    rows = np.arange(len(CENTERS))
    # about 1 / sqrt(1200 pairs), and 1 / sqrt(100 antennas a block): five times that
    assert max(agreements(noise, rows)) < 0.15
    assert block_agreement(noise, CENTERS) < 0.3


def test_errors_of_whole_rows_show_along_one_axis_only(rng: np.random.Generator) -> None:
    row = np.round(CENTERS[:, 1] / 0.01).astype(int) + 20
    phases = rng.normal(0.0, 1.0, 41)[row]
    along, across = agreements(np.exp(1j * phases), np.arange(len(CENTERS)))
    assert along == pytest.approx(1.0)
    # exp(-sigma^2) on average over normal phases; 40 pairs of rows leave 0.12 of scatter
    assert across == pytest.approx(np.exp(-1.0), abs=0.3)


def test_a_drift_shows_in_blocks_before_it_shows_in_neighbours() -> None:
    drifting = np.exp(1j * 2 * np.pi / 0.12 * CENTERS[:, 0])
    assert min(agreements(drifting, np.arange(len(CENTERS)))) == pytest.approx(1.0)
    assert block_agreement(drifting, CENTERS) < 0.5


def test_blocks_of_one_antenna_say_nothing() -> None:
    far = np.array([[0.0, 0, 0], [1.0, 0, 0]])
    assert block_agreement(np.ones(2, dtype=complex), far) == 0.0
