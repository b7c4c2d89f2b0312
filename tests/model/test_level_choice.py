"""Loss, argmin, coordinate descent and the last peak, on numbers that can be checked by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from waveformer.model.level_choice import (
    antenna_losses,
    component_losses,
    coordinate_descent,
    last_peak,
    residual_losses,
)


def complex_normal(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def test_mmnorms_loss_by_hand() -> None:
    measured = np.array([[3.0, 4.0j]])
    simulated = np.array([[[1.0, 0.0]], [[6.0j, -8.0]], [[0.0, 0.0]]])
    # units (0.6, 0.8) against (1, 0), (0.6, 0.8) and, without an echo, (0, 0)
    assert antenna_losses(measured, simulated, "magnitude")[:, 0] == pytest.approx([0.4 + 0.8, 0.0, 1.4])
    powers = np.array([[[36.0, 64.0]]])
    assert antenna_losses(measured, powers, "magnitude")[0, 0] == pytest.approx(0.0)


def test_complex_loss_by_hand() -> None:
    measured = np.array([[3.0, 4.0j]])
    simulated = np.array([[[3.0, 4.0j]], [[3.0j, -4.0]], [[4.0j, 3.0]], [[3.0, 4.0]], [[0.0, 0.0]]])
    # the profile itself; turned as a whole; nothing of it; |c| = |9 - 16j| / 25; without an echo
    unexplained = np.array([0.0, 0.0, 1.0, 1.0 - (81 + 256) / 625, 1.0])
    # 30 dB are all there is to explain: log(1 + 1000 x) / log(1 + 1000)
    assert antenna_losses(measured, simulated)[:, 0] == pytest.approx(
        np.log1p(1e3 * unexplained) / np.log(1001)
    )


def test_only_phases_tell_profiles_of_equal_magnitudes_apart() -> None:
    """As those of places within one bin nearly are."""
    magnitudes = np.array([0.2, 1.0, 1.0, 0.2])
    simulated = np.stack([magnitudes * np.exp(1j * turn * np.arange(4)) for turn in (-0.8, 0.0, 0.8)])[
        :, None
    ]
    measured = 2j * simulated[2]
    assert antenna_losses(measured, simulated, "magnitude")[:, 0] == pytest.approx([0.0] * 3)
    complex_losses = antenna_losses(measured, simulated)[:, 0]
    assert complex_losses[2] == pytest.approx(0.0, abs=1e-9)
    assert complex_losses[0] > complex_losses[1] > 0.5


def test_each_antenna_has_a_factor_of_its_own(rng: np.random.Generator) -> None:
    measured, simulated = complex_normal(rng, 7, 5), complex_normal(rng, 3, 7, 5)
    factors = complex_normal(rng, 7, 1)
    expected = antenna_losses(measured, simulated)
    assert antenna_losses(factors * measured, simulated) == pytest.approx(expected)
    assert antenna_losses(measured, factors * simulated) == pytest.approx(expected)
    assert ((expected > 0) & (expected < 1)).all()


def test_the_complex_loss_is_the_likelihood_of_a_free_factor(rng: np.random.Generator) -> None:
    """Minus log of the likelihood, maximised over factor and power of the rest, orders levels alike."""
    measured, simulated = complex_normal(rng, 4, 6), complex_normal(rng, 20, 4, 6)
    expected = np.zeros(20)
    for level, antenna in itertools.product(range(20), range(4)):
        factor = np.linalg.lstsq(simulated[level, antenna][:, None], measured[antenna], rcond=None)[0]
        rest = measured[antenna] - simulated[level, antenna] * factor
        expected[level] += np.log((np.abs(rest) ** 2).sum() / (np.abs(measured[antenna]) ** 2).sum())
    found = antenna_losses(measured, simulated).sum(axis=1)
    assert found.argmin() == expected.argmin()
    # 1 + x / 0.001 instead of x / 0.001: at most 1 per cent where at least a tenth stays unexplained
    assert found * np.log(1001) == pytest.approx(expected + 4 * np.log(1e3), abs=4 * 0.05)


def test_losses_of_correlations_lie_between_0_and_1() -> None:
    correlation = np.array([0.0, 0.5j, -1.0, 1.0 + 1e-9])
    losses = residual_losses(correlation)
    assert losses[0] == pytest.approx(1.0) and 0 < losses[1] < 1
    assert losses[2:] == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("loss", ["complex", "magnitude"])
def test_weak_echoes_do_not_underflow(loss: str) -> None:
    measured = np.array([[3e-30, 4e-30]], dtype=np.complex64)
    assert antenna_losses(measured, np.array([[[3.0, 4.0]]]) + 0j, loss)[0, 0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("num_components", [1, 2, 3])
def test_coordinate_descent_recovers_the_sum_it_was_made_from(
    num_components: int, rng: np.random.Generator
) -> None:
    scales = (1.0, 0.5, 0.25)[:num_components]
    responses = [scale * complex_normal(rng, 12, 40, 5) for scale in scales]
    truth = [int(level) for level in rng.integers(0, 12, num_components)]
    measured = sum(response[level] for response, level in zip(responses, truth, strict=True))
    for loss in ("complex", "magnitude"):
        assert coordinate_descent(measured, responses, loss) == truth


def test_coordinate_descent_ends_where_no_single_change_helps(rng: np.random.Generator) -> None:
    responses = [complex_normal(rng, 6, 3, 4) for _ in range(3)]
    measured = complex_normal(rng, 3, 4)  # of no relation: many local minima
    chosen = coordinate_descent(measured, responses)
    for index, response in enumerate(responses):
        losses = component_losses(measured, responses, chosen, index).sum(axis=1)
        assert np.argmin(losses) == chosen[index]
        assert losses.shape == (len(response),)
    every = [
        component_losses(measured, responses, levels, 0).sum(axis=1)[levels[0]]
        for levels in itertools.product(range(6), repeat=3)
    ]
    assert losses.min() <= np.quantile(every, 0.1)


def gaussian_dips(*dips: tuple[float, float]) -> np.ndarray:
    """Loss of 60 levels, 50 at most, with dips (position, depth)."""
    levels = np.arange(60)
    return 50.0 - sum(depth * np.exp(-(((levels - at) / 2) ** 2)) for at, depth in dips)


def test_the_last_clear_minimum_wins() -> None:
    assert last_peak(gaussian_dips((20, 40)), 50, False) == 20
    assert last_peak(gaussian_dips((20, 40), (45, 38)), 50, False) == 45  # 0.95 of the deepest
    assert last_peak(gaussian_dips((20, 40), (45, 30)), 50, False) == 20  # 0.75
    assert last_peak(gaussian_dips((0, 40), (45, 30)), 50, False) == 45  # the deepest at an end: 0.3 will do
    assert last_peak(gaussian_dips((20, 40), (45, 30)), 50, True) == 45  # a slice: 0.4 will do


def test_limits_scale_with_the_number_of_antennas() -> None:
    shallow = gaussian_dips((0, 2.0), (45, 1.5))  # prominence 1.5 counts at 50 antennas, not at 200
    assert last_peak(shallow, 50, False) == 45
    assert last_peak(shallow, 200, False) == 0


def test_a_flat_or_short_loss_has_a_minimum_too() -> None:
    assert last_peak(np.full(10, 3.0), 50, False) == 0
    assert last_peak(np.array([3.0]), 50, True) == 0
