"""MITO's imager: the answer its published arithmetic gives for one scatterer and four receivers."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator import Aperture, Chirp, Grid, Measurement, RadarError
from waveformer.simulator.floor_bin_image import floor_bin_image
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.reference import dense_backproject

START_HZ, SLOPE_HZ, SAMPLES, BIAS_M = 77.5001e9, 5_861_160.0, 512, 0.15
SCATTERER = np.array([0.0, 0.0, -0.4])
AT_SCATTERER = Grid(np.zeros(1), np.zeros(1), np.array([-0.4]))


def scan(sign: float = -1.0) -> Measurement:
    chirp = Chirp(START_HZ, SLOPE_HZ * SAMPLES, SAMPLES)
    half_wavelength_m = SPEED_OF_LIGHT_M_PER_S / START_HZ / 2.0
    rx = np.zeros((4, 3))
    rx[:, 0] = -0.005 - np.arange(3, -1, -1) * half_wavelength_m
    tx = np.zeros((4, 3))
    path_m = 0.4 + np.linalg.norm(rx - SCATTERER, axis=1) + BIAS_M
    h = np.exp(sign * 2j * np.pi * chirp.frequencies_hz * path_m[:, None] / SPEED_OF_LIGHT_M_PER_S)
    return Measurement(h, chirp, Aperture(tx, rx), BIAS_M)


def test_known_answer_for_one_scatterer() -> None:
    image = floor_bin_image(scan(), AT_SCATTERER, bandwidth_hz=3.0009e9)
    # five published decimals; h is stored in single precision: 2048 samples of 6e-8 each
    assert complex(image[0, 0, 0]) == pytest.approx(2046.56899 - 66.19657j, abs=2e-4)


def exact_value(measurement: Measurement) -> complex:
    bias_s = measurement.range_bias_m / SPEED_OF_LIGHT_M_PER_S
    h = measurement.h * np.exp(2j * np.pi * measurement.chirp.frequencies_hz * bias_s)
    return complex(dense_backproject(h, measurement.chirp, measurement.aperture, AT_SCATTERER)[0, 0, 0])


def test_eq_1_itself_gives_the_full_sum() -> None:
    assert exact_value(scan()) == pytest.approx(2048.0, abs=2e-4)


def test_recordings_of_the_other_sign_do_not_focus() -> None:
    assert abs(exact_value(scan(sign=+1.0))) < 0.01 * 2048.0


def test_non_finite_samples_are_refused() -> None:
    good = scan()
    h = good.h.copy()
    h[0, 0] = np.nan
    with pytest.raises(RadarError, match="non-finite"):
        floor_bin_image(Measurement(h, good.chirp, good.aperture), AT_SCATTERER)
