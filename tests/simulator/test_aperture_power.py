"""Power over place, direction and range."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.aperture_power import AperturePower
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

SHAPE = (10, 8, 4)
TX_M = Aperture.planar_grid(8, 10, 0.01).tx_m
NODES = Chirp(77e9, 3.6e9, 4)


def signal(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=SHAPE) + 1j * rng.normal(size=SHAPE)


def point(x_m: float, z_m: float) -> np.ndarray:
    """Echo of a point, shape (10, 8, 4)."""
    range_m = np.linalg.norm(TX_M - [x_m, 0.0, z_m], axis=1)
    wavenumbers = 4 * np.pi * NODES.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    return np.exp(-1j * range_m[:, None] * wavenumbers).reshape(SHAPE)


def flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, *values.shape[2:])


def beams_slowly(values: np.ndarray, size: int, hop: int) -> np.ndarray:
    """Amplitudes by explicit sums over the antennas of every sub-aperture, directions twice as dense as they."""
    window = np.sin(np.pi * np.arange(1, size + 1) / (size + 1)) ** 2
    taper = 0.54 - 0.46 * np.cos(2 * np.pi * np.arange(4) / 3)
    amplitudes = []
    for y in range(0, values.shape[0] - size + 1, hop):
        for x in range(0, values.shape[1] - size + 1, hop):
            for bin_y, bin_x, bin_z in np.ndindex(2 * size, 2 * size, 4):
                total = 0.0
                for j, i, m in np.ndindex(size, size, 4):
                    turns = -(bin_y * j + bin_x * i) / (2 * size) + bin_z * m / 4
                    weight = window[j] * window[i] * taper[m]
                    total += weight * values[y + j, x + i, m] * np.exp(2j * np.pi * turns)
                amplitudes.append(abs(total))
    return np.array(amplitudes)


def test_the_residual_equals_explicit_sums(rng: np.random.Generator) -> None:
    measured, other = signal(rng)[:6, :5], signal(rng)[:6, :5]
    feature = AperturePower(measured, 3, 2)
    powers = [beams_slowly(values, 3, 2) ** 2 for values in (measured, other)]
    floor = 0.02 * powers[0].mean()
    aim, there = (np.sqrt(power + floor) for power in powers)
    expected = (there - aim) / np.linalg.norm(aim - np.sqrt(floor))
    residual = feature.residual(flat(other))
    assert np.abs(np.sort(residual) - np.sort(expected)).max() < 1e-5 * np.abs(expected).max()  # float32


def test_the_measured_signal_itself_fits_whatever_its_phase(rng: np.random.Generator) -> None:
    measured = signal(rng)
    feature = AperturePower(measured, 4, 2)
    assert feature.misfits(flat(measured)[None])[0] < 1e-10  # float32
    assert feature.misfits(flat(measured * np.exp(2j))[None])[0] < 1e-10


def test_misfits_are_those_of_single_signals(rng: np.random.Generator) -> None:
    feature = AperturePower(signal(rng), 4, 2)
    others = np.stack([flat(signal(rng)) for _ in range(3)])
    expected = [(feature.residual(other).astype(float) ** 2).sum() for other in others]
    np.testing.assert_allclose(feature.misfits(others), expected, rtol=1e-5)  # float32


def test_the_misfit_of_a_point_grows_over_many_wavelengths() -> None:
    feature = AperturePower(point(0.0, -0.4), 4, 2)
    sideways = feature.misfits(np.stack([flat(point(x, -0.4)) for x in np.arange(0.0, 0.016, 0.002)]))
    assert (np.diff(sideways) > 0).all()  # at 4 mm wavelength the phase has turned 30 times
    away = feature.misfits(np.stack([flat(point(0.0, -0.4 - z)) for z in np.arange(0.0, 0.012, 0.002)]))
    assert (np.diff(away) > 0).all()


@pytest.mark.parametrize(("size", "hop"), [(4, 2), (6, 3)])
def test_derivatives_equal_central_differences(rng: np.random.Generator, size: int, hop: int) -> None:
    feature = AperturePower(signal(rng), size, hop)
    start, column = signal(rng), signal(rng)
    _, slopes = feature.linearise(flat(start), flat(column)[..., None])
    step = 1e-2
    ends = [feature.residual(flat(start + s * column)).astype(float) for s in (-step, step)]
    expected = (ends[1] - ends[0]) / (2 * step)
    # float32 residuals over a step of 1e-2, and the third derivative of an amplitude times its square
    assert np.linalg.norm(slopes[:, 0] - expected) < 1e-3 * np.linalg.norm(expected)
