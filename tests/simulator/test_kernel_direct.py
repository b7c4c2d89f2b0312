"""The direct sum over pairs, and the few frequencies that determine all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 4e9, 64)


def unit(legs: list[Any], _point: Any, _normal: Any, weight: Any, _taper: Any) -> tuple[Any, Any, None]:
    """An integrand without geometry but the path."""
    return weight, 0.5 * (legs[0].excess_m + legs[-1].excess_m), None


def echoes(radius_m: float, frequencies_hz: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    range_m = rng.uniform(-radius_m, radius_m, 50)
    return np.exp(-4j * np.pi / SPEED_OF_LIGHT_M_PER_S * range_m[:, None] * frequencies_hz)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize("radius_m", [0.0, 0.01, 0.1, 0.3])
def test_a_few_frequencies_give_all_samples_of_an_object(
    rng: np.random.Generator, radius_m: float, tolerance: float
) -> None:
    from waveformer.simulator.kernel_direct import frequency_nodes

    nodes_hz, to_samples = frequency_nodes(CHIRP, radius_m, tolerance)
    assert len(nodes_hz) < CHIRP.num_samples
    state = rng.bit_generator.state
    at_nodes = echoes(radius_m, nodes_hz, rng)
    rng.bit_generator.state = state
    expected = echoes(radius_m, CHIRP.frequencies_hz, rng)
    assert np.abs(at_nodes @ to_samples - expected).max() < tolerance + 1e-12  # the bound, and rounding


def test_an_object_as_deep_as_the_range_is_summed_at_every_frequency() -> None:
    from waveformer.simulator.kernel_direct import frequency_nodes

    nodes_hz, to_samples = frequency_nodes(Chirp(77e9, 4e9, 8), 0.3, 1e-6)
    assert (nodes_hz == Chirp(77e9, 4e9, 8).frequencies_hz).all()
    assert (to_samples == np.eye(8)).all()


def test_objects_of_several_metres_do_not_overflow() -> None:
    from waveformer.simulator.kernel_direct import frequency_nodes

    nodes_hz, _ = frequency_nodes(Chirp(77e9, 4e9, 256), 2.5, 1e-5)
    assert len(nodes_hz) <= 256


@pytest.mark.parametrize("num_samples", [1, 5, 700, 1500])
@pytest.mark.parametrize("is_bistatic", [False, True])
def test_the_sum_over_pairs_equals_numpy(
    rng: np.random.Generator, num_samples: int, is_bistatic: bool
) -> None:
    from waveformer.simulator.kernel_direct import sum_pairs

    table = np.zeros((num_samples, 8))
    table[:, :3] = rng.uniform(-0.02, 0.02, (num_samples, 3))
    table[:, 5] = 1.0
    table[:, 6] = rng.uniform(0.5, 1.0, num_samples)
    tx_m = rng.uniform(-0.1, 0.1, (4, 3)) + [0, 0, 0.3]
    rx_m = tx_m + rng.uniform(-0.03, 0.03, (4, 3)) if is_bistatic else None
    visible = rng.random((4, num_samples)) < 0.7
    frequencies_hz = np.linspace(77e9, 81e9, 11)  # more than one launch
    sums = sum_pairs(table, visible, tx_m, rx_m, frequencies_hz, unit)
    assert sums.shape == (4, 11)
    for row in range(4):
        excess_m = np.zeros(num_samples)
        for antenna in (tx_m[row], (tx_m if rx_m is None else rx_m)[row]):
            excess_m += np.linalg.norm(antenna - table[:, :3], axis=1) - np.linalg.norm(antenna)
        phase = np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_PER_S * excess_m[:, None] * frequencies_hz)
        expected = (visible[row] * table[:, 6]) @ phase
        # float32: a phasor of 1.3e-6 and range differences of 1e-8 m, times the sum of all weights
        assert np.abs(sums[row] - expected).max() < 2e-5 * max(1.0, table[:, 6].sum())


def test_an_antenna_that_sees_nothing_sums_to_zero(rng: np.random.Generator) -> None:
    from waveformer.simulator.kernel_direct import sum_pairs

    table = rng.uniform(0.01, 0.02, (20, 8))
    visible = np.array([[False] * 20, [True] * 20])
    tx_m = np.array([[0, 0, 0.3], [0, 0, 0.3]])
    sums = sum_pairs(table, visible, tx_m, None, np.array([77e9]), unit)
    assert sums[0, 0] == 0
    assert sums[1, 0] != 0
