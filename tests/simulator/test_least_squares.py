"""Fits on signals written down by hand: what is found, from how far, and how well it is known."""

from __future__ import annotations

from typing import Any

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
    # the signal tells nothing of it, so it is known as well as before
    assert float(found.deviations[1]) == pytest.approx(1.0, rel=1e-6)
    assert float(found.deviations[0]) < 1e-5


def test_a_prior_pulls_back_what_an_earlier_stage_had_moved(rng: np.random.Generator) -> None:
    still = points(torch.zeros(3, dtype=torch.float64))
    direction = 0.01 * noise(still, rng, 1.0)
    # the signal tells 1 in the middle of the band and in all of it, but there with so much noise that the prior tells more
    outer = torch.ones(32)
    outer[8:24] = 0.0
    disturbance = noise(still, rng, 3.0) * outer
    along = (direction.conj() * disturbance).real.sum() / (direction.abs() ** 2 * outer).sum()
    measured = still + direction + disturbance - along * direction * outer
    start, prior = torch.zeros(1, dtype=torch.float64), torch.tensor([0.05], dtype=torch.float64)

    def model(values: torch.Tensor) -> torch.Tensor:
        return still + values[0] * direction

    stages = [Stage(bandwidth_share=0.5), Stage()]
    half, found = (
        fit(model, measured, start, torch.ones(1), stages[:count], prior_deviations=prior) for count in (1, 2)
    )
    assert float(half.values[0]) == pytest.approx(1.0, abs=1e-3)
    # the closed form for noise of the present misfit
    variance = found.misfit * float((measured.abs() ** 2).sum()) / (2 * measured.numel())
    told = float((direction.conj() * (measured - still)).real.sum())
    known = float((direction.abs() ** 2).sum())
    expected = told / (known + variance / 0.05**2)
    assert abs(expected) < 0.2
    # a step is not worth taking below 1e-6 of 9216 squares, so a tenth of the deviation of 0.05 may be left
    assert float(found.values[0]) == pytest.approx(expected, abs=5e-3)


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


def test_a_start_where_the_signal_hardly_changes_does_not_throw_the_fit_off() -> None:
    def faded(values: torch.Tensor) -> torch.Tensor:
        # like roughness: a small value changes little, a large one leaves no echo
        return (
            points(torch.zeros(3, dtype=torch.float64)) * torch.exp(-((values[0].exp()) ** 2))
            + 0.0 * values[0]
        )

    truth = torch.tensor([0.0], dtype=torch.float64)
    start = torch.tensor([-3.0], dtype=torch.float64)
    found = fit(faded, faded(truth), start, torch.tensor([0.5], dtype=torch.float64))
    assert abs(float(found.values[0])) < 1e-4


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


MEASURED, START, SCALES = points(torch.zeros(3)), torch.zeros(3), torch.ones(3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"measured": MEASURED.numpy()}, r"measured must be a complex tensor of shape \(N, T\), got complex128 of shape"),
        ({"measured": MEASURED.real}, "measured must be a complex tensor"),
        ({"measured": MEASURED * torch.nan}, "measured must be finite: 4608 of 4608 samples"),
        ({"measured": MEASURED * 0}, "measured is zero everywhere: there is nothing to fit"),
        ({"measured": MEASURED[:1]}, r"measured of shape \(1, 32\) must have that of the model, \(144, 32\)"),
        ({"start": torch.zeros(0)}, r"start must be a real tensor of shape \(P,\) with P >= 1"),
        ({"start": START * torch.nan}, "start must be finite"),
        ({"scales": SCALES * 0}, "scales must be positive"),
        ({"scales": SCALES[:2]}, r"scales must be a real tensor of shape \(3,\), one for each parameter"),
        ({"prior_deviations": SCALES * 0}, "prior_deviations must be positive"),
        ({"prior_deviations": SCALES[0]}, r"prior_deviations must be a real tensor of shape \(3,\)"),
        ({"stages": []}, "a fit needs at least one stage"),
        ({"stages": [Stage(TILES[:7])]}, "groups must be whole numbers from 0, one for each of 144 pairs, got torch.int64"),
        ({"stages": [Stage(TILES.double())]}, "groups must be whole numbers from 0"),
        ({"stages": [Stage(TILES - 1)]}, "groups must be whole numbers from 0"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(changes: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {"model": points, "measured": MEASURED, "start": START, "scales": SCALES}
    with pytest.raises(RadarError, match=f"^{message}") as caught:
        fit(**(given | changes))
    assert "\n" not in str(caught.value)


def test_parameters_that_the_model_ignores_stay_where_they_are() -> None:
    found = fit(lambda values: MEASURED + 0.1 + 0.0 * values[0], MEASURED, START + 2.0, SCALES)
    assert (found.values == 2.0).all()
    assert torch.isinf(found.deviations).all()
