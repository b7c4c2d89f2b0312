"""Bias, gain and row depths: recovered from point scatterers written down by hand, and the model's derivative."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from waveformer.simulator import primitives
from waveformer.simulator.calibration import calibrate, depth_model
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


def test_shapes_must_fit(rng: np.random.Generator) -> None:
    with pytest.raises(RadarError, match=r"\(3, 32\).*192 pairs"):
        calibrate(np.zeros((3, 32), np.complex64), ROWS, CHIRP, points(rng))
