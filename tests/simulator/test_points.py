"""Ideal point scatterers against their closed formula."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator.errors import RadarError
from waveformer.simulator.points import simulate_points
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 4e9, 64)
GRID = Aperture.planar_grid(4, 3, 0.02)
PAIRS = Aperture(GRID.tx_m, GRID.tx_m + [0.05, 0.01, 0.0])


def closed_form(points_m: np.ndarray, rcs_m2: np.ndarray, chirp: Chirp, aperture: Aperture) -> np.ndarray:
    """sqrt(sigma) lambda / ((4 pi)^1.5 R_tx R_rx) exp(-j k (R_tx + R_rx)), summed in float64."""
    h = np.zeros((len(aperture), chirp.num_samples), dtype=complex)
    for point, rcs in zip(points_m, rcs_m2, strict=True):
        out = np.linalg.norm(aperture.tx_m - point, axis=1)[:, None]
        back = np.linalg.norm(aperture.receivers_m - point, axis=1)[:, None]
        k = 2 * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
        amplitude = np.sqrt(rcs) * chirp.wavelengths_m / ((4 * np.pi) ** 1.5 * out * back)
        h += amplitude * np.exp(-1j * k * (out + back))
    return h


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


@pytest.mark.parametrize("aperture", [GRID, PAIRS], ids=["monostatic", "pairs"])
@pytest.mark.parametrize(("count", "extent_m"), [(1, 0.0), (2, 0.001), (40, 0.1), (700, 0.3)])
def test_points_follow_the_closed_formula(
    rng: np.random.Generator, aperture: Aperture, count: int, extent_m: float
) -> None:
    points = rng.uniform(-0.5, 0.5, (count, 3)) * extent_m + [0.02, -0.01, -0.5]
    rcs = rng.uniform(0.001, 1.0, count)
    h = simulate_points(points, rcs, CHIRP, aperture).h
    assert h.dtype == np.complex64
    # float32, range differences of 1e-8 m included, on amplitudes that add up to ten times their sum or more
    assert difference(h, closed_form(points, rcs, CHIRP, aperture)) < 1e-4


def test_a_point_far_away_keeps_its_phase() -> None:
    point = np.array([[0.0, 1.0, -2.0]])
    # phases to the reference point are float64: only the float32 result rounds
    assert difference(
        simulate_points(point, 1.0, CHIRP, GRID).h, closed_form(point, np.ones(1), CHIRP, GRID)
    ) < 2e-6  # fmt: skip


def test_moving_a_point_away_by_an_eighth_of_a_wavelength_turns_the_phase_by_minus_90_degrees() -> None:
    single = Aperture.from_preset("single")
    step_m = CHIRP.wavelengths_m[10] / 8
    near, far = (simulate_points([[0, 0, -0.4 - s]], 1.0, CHIRP, single).h[0, 10] for s in (0, step_m))
    # the ratio of spreading is 1 - 2 step / 0.4 m, its phase exact
    assert far / near == pytest.approx(-1j * (0.4 / (0.4 + step_m)) ** 2, abs=1e-5)


def test_two_points_superpose(rng: np.random.Generator) -> None:
    points = rng.uniform(-0.05, 0.05, (2, 3)) - [0, 0, 0.4]
    both = simulate_points(points, [1.0, 0.3], CHIRP, PAIRS).h
    apart = (
        simulate_points(points[:1], 1.0, CHIRP, PAIRS).h + simulate_points(points[1:], 0.3, CHIRP, PAIRS).h
    )
    assert difference(both, apart) < 1e-5  # float32 about different reference points


def test_one_cross_section_serves_all_points() -> None:
    points = [[0, 0, -0.4], [0.01, 0, -0.41]]
    assert (
        simulate_points(points, 0.2, CHIRP, GRID).h == simulate_points(points, [0.2, 0.2], CHIRP, GRID).h
    ).all()


def test_no_cross_section_means_no_echo() -> None:
    assert not simulate_points([[0, 0, -0.4]], 0.0, CHIRP, GRID).h.any()


def test_swapping_transmitters_and_receivers_changes_nothing() -> None:
    points = [[0.01, 0.02, -0.4], [0, 0, -0.35]]
    swapped = Aperture(PAIRS.receivers_m, PAIRS.tx_m)
    one, other = (simulate_points(points, 1.0, CHIRP, pairs).h for pairs in (PAIRS, swapped))
    assert difference(one, other) < 1e-6  # float32 in another order


@pytest.mark.parametrize(
    ("points_m", "rcs_m2", "says"),
    [
        ([0.0, 0.0, -0.4], 1.0, r"shape \(M, 3\)"),
        ([[0.0, -0.4]], 1.0, r"shape \(M, 3\)"),
        (np.zeros((0, 3)), 1.0, "M >= 1"),
        ([[0.0, 0.0, np.nan]], 1.0, "finite"),
        ([[0.0, 0.0, -0.4]], [1.0, 2.0], r"one per point \(1\)"),
        ([[0.0, 0.0, -0.4]], -1.0, "not negative"),
        ([[0.0, 0.0, -0.4]], np.inf, "finite"),
        ([[0.0, 0.0, -4.0]], 1.0, "unambiguous range 2.40 m"),
        ([[0.0, 0.0, -0.4], GRID.tx_m[5]], 1.0, "coincides with an antenna"),
    ],
)
def test_bad_points_are_refused_with_a_reason(points_m: Any, rcs_m2: Any, says: str) -> None:
    with pytest.raises(RadarError, match=says):
        simulate_points(points_m, rcs_m2, CHIRP, GRID)


def test_points_several_metres_apart_are_summed() -> None:
    chirp, single = Chirp(77e9, 4e9, 256), Aperture.from_preset("single")
    points = np.array([[0, 0, -1.0], [0, 0, -5.0]])
    expected = closed_form(points, np.ones(2), chirp, single)
    assert difference(simulate_points(points, 1.0, chirp, single).h, expected) < 1e-4  # float32 at 2 m
