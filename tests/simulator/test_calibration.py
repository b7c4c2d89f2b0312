"""Bias, gain and row depths: recovered from point scatterers written down by hand, and the model's derivative."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from waveformer.simulator import Antenna, Box, calibration, primitives
from waveformer.simulator.calibration import calibrate, depth_model
from waveformer.simulator.differentiable import simulate
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_positions import raster_rows
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

CHIRP = Chirp(77e9, 4e9, 32)
APERTURE = Aperture.planar_grid(num_x=16, num_y=12, spacing_m=0.02)
ROWS = raster_rows(APERTURE)


def points(rng: np.random.Generator):
    """A cloud of point scatterers 0.3 m away as a depth model, its derivative in closed form."""
    places = rng.uniform([-0.08, -0.08, -0.34], [0.08, 0.08, -0.28], (12, 3))
    wavenumbers = 2.0 * np.pi * CHIRP.frequencies_hz / SPEED_OF_LIGHT_M_PER_S

    def model(depths_m: NDArray[np.float64]) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
        ways = APERTURE.tx_m[:, None] + depths_m[:, None, None] * [0.0, 0.0, 1.0] - places
        distance = np.linalg.norm(ways, axis=2)
        waves = np.exp(-2j * distance[:, :, None] * wavenumbers)
        slopes = -2j * (ways[:, :, 2] / distance)[:, :, None] * wavenumbers * waves
        return waves.sum(axis=1), slopes.sum(axis=1)

    return model


@pytest.mark.parametrize("trial", range(4))
def test_bias_gain_and_rows_are_found(trial: int) -> None:
    rng = np.random.default_rng([trial, 5])
    model = points(rng)
    depths = 3e-4 * rng.standard_normal(ROWS.max() + 1)
    bias_m, gain_db = rng.uniform(-0.05, 0.05), rng.uniform(-5.0, 5.0)
    h = model(depths[ROWS])[0] * 10.0 ** (gain_db / 10.0)
    h = h * np.exp(-2j * np.pi * CHIRP.frequencies_hz / SPEED_OF_LIGHT_M_PER_S * bias_m)
    level = np.sqrt((np.abs(h) ** 2).mean())
    h = h + 0.3 * level * (rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape))
    found = calibrate(h.astype(np.complex64), ROWS, CHIRP, model)
    # five of the standard deviations that the fit states
    assert abs(found.range_bias_m - bias_m) < 5.0 * found.deviations_m[0]
    assert (np.abs(found.row_depth_m - depths) < 5.0 * found.deviations_m[1:]).all()
    assert found.deviations_m.max() < 1e-4
    assert found.antenna_gain_db == pytest.approx(gain_db, abs=0.05)
    assert found.misfit == pytest.approx(2 * 0.3**2 / (1 + 2 * 0.3**2), rel=0.1)


def scanned(
    model: Any, depths: NDArray[np.float64], bias_m: float, gain_db: float = 0.0
) -> NDArray[np.complex64]:
    """What a radar measures."""
    turn = np.exp(-2j * np.pi * CHIRP.frequencies_hz / SPEED_OF_LIGHT_M_PER_S * bias_m)
    return (model(depths[ROWS])[0] * 10.0 ** (gain_db / 10.0) * turn).astype(np.complex64)


@pytest.mark.parametrize("seed", range(6))
def test_rows_of_a_twelfth_of_a_wavelength_end_in_no_other_branch(seed: int) -> None:
    rng = np.random.default_rng([seed, 6])
    model, depths = points(rng), 3e-4 * rng.standard_normal(ROWS.max() + 1)
    # what they share goes with the bias, up to how the ways incline: turned by half a wave they would be 0.95 mm off
    found = calibrate(scanned(model, depths, 0.02), ROWS, CHIRP, model)
    assert np.abs(found.row_depth_m - depths).max() < 1e-5
    assert found.range_bias_m == pytest.approx(0.02, abs=1e-5)
    # float32 of the signal
    assert found.misfit < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_a_signal_of_the_other_sign_moves_the_bias_and_no_row(seed: int) -> None:
    rng = np.random.default_rng([seed, 7])
    model, depths = points(rng), 1e-4 * rng.standard_normal(ROWS.max() + 1)
    found = calibrate(-scanned(model, depths, 0.01), ROWS, CHIRP, model)
    half_wave_m = 0.5 * SPEED_OF_LIGHT_M_PER_S / CHIRP.center_hz
    # half a wavelength of path is half a turn at the middle of the band, and 0.08 rad off at its ends
    assert abs(abs(found.range_bias_m - 0.01) - half_wave_m) < 1e-4
    apart = found.row_depth_m - depths
    assert np.ptp(apart) < 1e-4


def test_the_misfit_is_that_of_the_values_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    # after one round the last step still matters
    monkeypatch.setattr(calibration, "_ROUNDS", 1)
    rng = np.random.default_rng(8)
    model, depths = points(rng), 3e-4 * rng.standard_normal(ROWS.max() + 1)
    h = scanned(model, depths, 0.02, 1.5)
    h = h + 0.2 * (rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)).astype(np.complex64)
    found = calibrate(h, ROWS, CHIRP, model)
    again = scanned(model, found.row_depth_m, found.range_bias_m, found.antenna_gain_db)
    # float32 of a signal
    assert found.misfit == pytest.approx((np.abs(h - again) ** 2).sum() / (np.abs(h) ** 2).sum(), rel=1e-6)


def test_the_depth_model_is_the_echo_and_its_slope() -> None:
    ball = primitives.sphere(0.02, 0.004)
    vertices = np.asarray(ball.vertices) + [0.01, 0.0, -0.3]
    aperture = Aperture.planar_grid(num_x=4, num_y=3, spacing_m=0.02)
    model = depth_model(vertices, np.asarray(ball.faces), CHIRP, aperture.tx_m)
    rise = 2e-4 * np.arange(12)
    echo, slope = model(rise)
    step = 1e-5
    difference = (model(rise + step)[0].astype(complex) - model(rise - step)[0]) / (2 * step)
    # float32 signals: 1e-7 over a phase of 0.03 rad; truncation 2e-4
    assert np.linalg.norm(slope - difference) < 1e-3 * np.linalg.norm(slope)
    assert np.linalg.norm(echo) > 0


def test_the_depth_model_takes_all_settings_of_the_forward_model() -> None:
    ball = primitives.sphere(0.006, 0.003)
    vertices, faces = np.asarray(ball.vertices) + [0.01, 0.0, -0.3], np.asarray(ball.faces)
    tx_m = Aperture.planar_grid(num_x=2, num_y=2, spacing_m=0.02).tx_m
    settings: dict[str, Any] = {
        "box": Box((-0.02, -0.02, -0.33), (0.03, 0.02, -0.28), 0.004, 1.8),
        "antenna": Antenna.from_preset("iwr1443"),
        "permittivity": torch.tensor(3.0 - 0.1j, requires_grad=True),
    }
    leaf = torch.tensor(vertices, requires_grad=True)
    echo, _ = depth_model(leaf, faces, CHIRP, tx_m, tx_m + 0.005, **settings)(np.zeros(4))
    expected = simulate(vertices, faces, CHIRP, tx_m, tx_m + 0.005, **settings).detach().numpy()
    np.testing.assert_array_equal(echo, expected)
    with pytest.raises(RadarError, match="mode of the differentiable model"):
        depth_model(vertices, faces, CHIRP, tx_m, mode="nonsense")


H = np.ones((len(ROWS), 32), np.complex64)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"h": H[:3]},
            r"h must be complex numbers of shape .* \(192, 32\), got complex64 of shape \(3, 32\)",
        ),
        ({"h": H * np.nan}, "h must be finite: 6144 of 6144 samples"),
        ({"h": H * 0}, "h is zero everywhere"),
        ({"h": "x"}, "h must be complex numbers"),
        (
            {"rows": ROWS * 2},
            r"rows must number all rows from 0 to 22, but 11 of them, such as 1, have no pair",
        ),
        ({"rows": ROWS - 1}, "rows must be whole numbers from 0"),
        (
            {"rows": ROWS.astype(float)},
            r"rows must be whole numbers from 0, shape \(N,\), got float64 of shape",
        ),
        (
            {"row_deviation_m": 0.0},
            "row_deviation_m must lie in 0 .. 0.000316 m, a twelfth of a wavelength, got 0",
        ),
        ({"row_deviation_m": 1e-3}, "row_deviation_m must lie in 0 .. 0.000316 m"),
        ({"row_deviation_m": np.nan}, "row_deviation_m must be one real number, finite"),
        ({"largest_bias_m": -1.0}, "largest_bias_m must be positive"),
        ({"chirp": None}, "chirp must be a Chirp"),
    ],
)
def test_what_makes_no_sense_is_refused(
    rng: np.random.Generator, changes: dict[str, Any], message: str
) -> None:
    given: dict[str, Any] = {"h": H, "rows": ROWS, "chirp": CHIRP, "model": points(rng)}
    with pytest.raises(RadarError, match=f"^{message}") as caught:
        calibrate(**(given | changes))
    assert "\n" not in str(caught.value)


def test_a_signal_may_be_a_tensor_and_a_row_must_see_the_object(rng: np.random.Generator) -> None:
    model, depths = points(rng), np.zeros(ROWS.max() + 1)
    h = scanned(model, depths, 0.01)
    of_tensor = calibrate(torch.from_numpy(h), ROWS, CHIRP, model)
    assert of_tensor.range_bias_m == calibrate(h, ROWS, CHIRP, model).range_bias_m

    def blind(depths_m: NDArray[np.float64]) -> Any:
        return [part * (ROWS != 4)[:, None] for part in model(depths_m)]

    with pytest.raises(RadarError, match="row 4 does not see the known object"):
        calibrate(h, ROWS, CHIRP, blind)
