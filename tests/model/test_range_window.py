"""The compared range bins, and what an echo shows in them."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.model.range_window import (
    RangeWindow,
    dirichlet,
    measured_profiles,
    mmnorm_window,
    object_window,
)
from waveformer.simulator.errors import RadarError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

MITO = Chirp(77.5001e9, 3.0009e9, 512)
CHIRP = Chirp(77.5001e9, 3.0009e9, 64)


def test_mmnorms_window_with_mitos_chirp() -> None:
    # bins and ranges as derived from the original's constants; its table rounds to a millimetre
    window = mmnorm_window(MITO, 3)
    assert window.bins.tolist() == [[8, 9, 10, 11]] * 3
    range_m, column = window.lattice()
    assert range_m == pytest.approx([0.325, 0.375, 0.425, 0.474], abs=6e-4)
    assert column.tolist() == [[0, 1, 2, 3]] * 3


def test_a_chirp_without_two_bins_there_is_refused() -> None:
    with pytest.raises(RadarError, match='use window "object"'):
        mmnorm_window(Chirp(24e9, 0.2e9, 64), 3)


@pytest.mark.parametrize("depth_m", [0.2, 0.45, 1.7])
def test_the_objects_window_has_a_bin_to_spare_at_either_end(depth_m: float) -> None:
    near, far = np.array([depth_m, depth_m + 0.013]), np.array([depth_m + 0.07, depth_m + 0.12])
    window = object_window(CHIRP, near, far)
    range_m, column = window.lattice()
    inner = range_m[column][:, 1:-1]
    assert (inner.min(axis=1) <= near).all()
    assert (inner.max(axis=1) >= far).all()
    assert (inner.min(axis=1) > near - CHIRP.range_bin_m).all()


def test_the_objects_window_is_at_most_the_whole_profile() -> None:
    window = object_window(Chirp(77e9, 4e9, 8), np.array([0.1]), np.array([2.0]))
    assert window.bins.shape == (1, 8)


def test_windows_of_several_antennas_share_a_lattice() -> None:
    window = RangeWindow(np.array([[7, 8], [5, 6]]), 0.05, -0.01)
    range_m, column = window.lattice()
    assert range_m == pytest.approx([0.24, 0.29, 0.34, 0.39])
    assert column.tolist() == [[2, 3], [0, 1]]
    assert window.take(np.array([1])).bins.tolist() == [[5, 6]]


@pytest.mark.parametrize("num_samples", [7, 64])
def test_dirichlet_is_the_mean_over_the_samples(num_samples: int, rng: np.random.Generator) -> None:
    chirp = Chirp(77e9, 3e9, num_samples)
    period = chirp.unambiguous_range_m
    distance = np.concatenate([rng.uniform(-2, 2, 50), [0.0, period, -period, chirp.range_bin_m]])
    phase = 4 * np.pi * (chirp.frequencies_hz - chirp.center_hz) / SPEED_OF_LIGHT_M_PER_S
    expected = np.cos(distance[:, None] * phase).mean(axis=1)
    assert dirichlet(chirp, distance) == pytest.approx(expected, abs=1e-9)  # rounding, near the zeros of sin


@pytest.mark.parametrize("bias_m", [0.0, 0.15])
def test_an_echo_in_the_window(bias_m: float) -> None:
    tau = (2 * 0.43 + bias_m) / SPEED_OF_LIGHT_M_PER_S
    h = 0.3 * np.exp(-2j * np.pi * CHIRP.frequencies_hz * tau)
    scan = Measurement(np.stack([0 * h, h]), CHIRP, Aperture(np.zeros((2, 3))), bias_m)
    window = RangeWindow(np.array([[7, 8, 9, 10]]), CHIRP.range_bin_m)
    profile = measured_profiles(scan, np.array([1]), window)
    range_m, _ = window.lattice()
    carrier = np.exp(-4j * np.pi * CHIRP.center_hz / SPEED_OF_LIGHT_M_PER_S * 0.43)
    expected = 0.3 * carrier * dirichlet(CHIRP, 0.43 - range_m)
    assert profile.shape == (1, 4)
    assert profile[0] == pytest.approx(expected, abs=1e-6)  # complex64
