"""Fits on signals written down by hand: what is found, from how far, and how well it is known."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from waveformer.simulator.errors import RadarError
from waveformer.simulator.least_squares import Stage, fit, linearise
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

CHIRP = Chirp(77e9, 4e9, 32)
ANTENNAS_M = torch.from_numpy(
    np.stack([*np.meshgrid(np.linspace(-0.1, 0.1, 12), np.linspace(-0.1, 0.1, 12)), np.zeros((12, 12))], -1)
).reshape(-1, 3)
POINTS_M = torch.tensor([[0.03, 0.0, -0.4], [-0.04, 0.02, -0.42], [0.0, -0.05, -0.38]], dtype=torch.float64)
# 3 x 3 tiles of 4 x 4 antennas
TILES = torch.from_numpy((np.arange(144) // 12 // 4) * 3 + np.arange(144) % 12 // 4)


def points(shift: torch.Tensor) -> torch.Tensor:
    """Three point scatterers moved by a shift in metres."""
    path = 2.0 * torch.linalg.vector_norm(ANTENNAS_M[:, None] - (POINTS_M + shift), dim=2)
    wavenumbers = torch.from_numpy(2.0 * np.pi * CHIRP.frequencies_hz / SPEED_OF_LIGHT_M_PER_S)
    return torch.exp(-1j * path[:, :, None] * wavenumbers).sum(1)


def noise(like: torch.Tensor, rng: np.random.Generator, deviation: float) -> torch.Tensor:
    values = rng.standard_normal((2, *like.shape)) * deviation
    return torch.from_numpy(values[0] + 1j * values[1])


def test_the_jacobian_is_that_of_central_differences() -> None:
    values = torch.tensor([1e-4, -2e-4, 3e-4], dtype=torch.float64)
    signal, columns = linearise(points, values)
    assert torch.allclose(signal, points(values))
    for place in range(3):
        step = 1e-7 * torch.eye(3, dtype=torch.float64)[place]
        slope = (points(values + step) - points(values - step)) / 2e-7
        # rounding of the differences
        assert torch.linalg.vector_norm(columns[place] - slope) < 1e-6 * torch.linalg.vector_norm(slope)


def test_a_small_shift_is_found_to_what_the_noise_allows(rng: np.random.Generator) -> None:
    truth = torch.tensor([1e-4, -2e-4, 1.5e-4], dtype=torch.float64)
    measured = points(truth) + noise(points(truth), rng, 0.3)
    found = fit(points, measured, torch.zeros(3), torch.full((3,), 1e-3))
    # five standard deviations each, which the fit states itself; and that statement is right to a factor of two
    assert ((found.values - truth).abs() < 5.0 * found.deviations).all()
    _, columns = linearise(points, truth)
    real = torch.view_as_real(columns).reshape(3, -1)
    bound = 0.3 * torch.linalg.inv(real @ real.T).diagonal().sqrt()
    assert torch.allclose(found.deviations, bound, rtol=0.1)


def test_free_gains_of_small_groups_lead_over_many_wavelengths(rng: np.random.Generator) -> None:
    truth = torch.tensor([3e-3, -2e-3, 2e-3], dtype=torch.float64)  # far beyond an eighth of a wavelength
    measured = points(truth) + noise(points(truth), rng, 0.1)
    scales = torch.full((3,), 1e-3)
    plain = fit(points, measured, torch.zeros(3), scales)
    whole = torch.zeros(144, dtype=torch.int64)
    coarse = fit(points, measured, torch.zeros(3), scales, [Stage(TILES), Stage(whole), Stage()])
    assert torch.linalg.vector_norm(plain.values - truth) > 1e-3
    assert torch.linalg.vector_norm(coarse.values - truth) < 2e-5


def test_a_free_gain_makes_level_and_phase_of_a_group_meaningless() -> None:
    truth = torch.tensor([1e-4, 0.0, 0.0], dtype=torch.float64)
    gains = torch.polar(torch.linspace(0.5, 2.0, 9), torch.linspace(-3.0, 3.0, 9)).to(torch.complex128)
    measured = points(truth) * gains[TILES][:, None]
    found = fit(points, measured, torch.zeros(3), torch.full((3,), 1e-3), [Stage(TILES)])
    assert torch.linalg.vector_norm(found.values - truth) < 1e-8
    assert found.misfit < 1e-9


def test_a_part_of_the_band_is_the_middle_one() -> None:
    truth = torch.tensor([1e-4, 0.0, 0.0], dtype=torch.float64)
    measured = points(truth)
    spoilt = measured.clone()
    spoilt[:, [0, -1]] = 100.0
    half = fit(points, spoilt, torch.zeros(3), torch.full((3,), 1e-3), [Stage(bandwidth_share=0.5)])
    assert torch.linalg.vector_norm(half.values - truth) < 1e-8


def test_a_prior_holds_what_the_signal_does_not_tell() -> None:
    def model(values: torch.Tensor) -> torch.Tensor:
        return points(torch.stack([values[0], values[0] * 0, values[0] * 0])) + 0.0 * values[1]

    measured = points(torch.tensor([1e-4, 0.0, 0.0], dtype=torch.float64)) + 0.01
    start = torch.tensor([0.0, 7.0], dtype=torch.float64)
    scales = torch.tensor([1e-3, 1.0], dtype=torch.float64)
    prior = torch.tensor([float("inf"), 1.0], dtype=torch.float64)
    found = fit(model, measured, start, scales, prior_deviations=prior)
    assert float(found.values[1]) == pytest.approx(7.0)
    assert float(found.values[0]) == pytest.approx(1e-4, abs=1e-6)


def test_what_a_stage_cannot_see_stays_where_it_was() -> None:
    def single(values: torch.Tensor) -> torch.Tensor:
        # single precision: what the free gain takes out leaves rounding errors behind
        return (points(values[:3]) * torch.exp(0.1 * values[3])).to(torch.complex64)

    truth = torch.tensor([1e-4, 0.0, 0.0, 3.0], dtype=torch.float64)
    scales = torch.tensor([1e-3, 1e-3, 1e-3, 1.0], dtype=torch.float64)
    free = [Stage(TILES)]
    found = fit(single, single(truth), torch.zeros(4), scales, free)
    assert abs(float(found.values[3])) < 1e-3
    assert torch.isinf(found.deviations[3])
    assert torch.isfinite(found.deviations[:3]).all()
    assert torch.linalg.vector_norm(found.values[:3] - truth[:3]) < 1e-6
    whole = fit(single, single(truth), torch.zeros(4), scales, [*free, Stage()])
    assert float(whole.values[3]) == pytest.approx(3.0, abs=1e-3)


def test_values_that_the_model_refuses_are_stepped_around() -> None:
    truth = torch.tensor([2e-4, 0.0, 0.0], dtype=torch.float64)

    def model(values: torch.Tensor) -> torch.Tensor:
        if float(values.detach()[0]) > 2.5e-4:
            raise RadarError("out of range")
        return points(values)

    found = fit(model, points(truth), torch.zeros(3), torch.full((3,), 1e-3))
    assert torch.linalg.vector_norm(found.values - truth) < 1e-8


@pytest.mark.parametrize("share", [0.0, -1.0, 1.1, float("nan")])
def test_a_share_of_the_band_is_a_share(share: float) -> None:
    with pytest.raises(RadarError, match="bandwidth_share"):
        Stage(bandwidth_share=share)
