"""Thermal noise: the three ways to state its level, and the noise itself.

The range profile is the inverse FFT of T samples, which divides by T: an echo of amplitude a in the middle of a
bin has power ``|a|^2`` there, white noise of power p per sample has p / T in every bin.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_streams import draw_rows
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

MIRROR_DISTANCE_M = 0.4
BOLTZMANN_J_PER_K = 1.380649e-23
# The temperature to which noise figures refer (IEEE Std 161).
REFERENCE_TEMPERATURE_K = 290.0
_BLOCK_ROWS = 1024


def signal_power(h: ArrayLike) -> NDArray[np.float64]:
    """Power of the strongest range-profile bin of every row, no window.

    Args:
        h: ideal signal, shape (n, T).

    Returns:
        Powers, shape (n,). Their median over all rows is the signal in `FrontEnd.snr_db`.
    """
    rows = np.asarray(h)
    powers = np.empty(len(rows))
    for start in range(0, len(rows), _BLOCK_ROWS):
        profile = np.fft.ifft(rows[start : start + _BLOCK_ROWS], axis=1)
        powers[start : start + _BLOCK_ROWS] = (profile.real**2 + profile.imag**2).max(axis=1)
    return powers


def mirror_power(chirp: Chirp, antenna: Antenna) -> float:
    """`signal_power` of a perfect flat mirror at 0.4 m: h = -G lambda / (8 pi d) exp(-2 j k d)."""
    phase = -4j * np.pi * chirp.frequencies_hz * MIRROR_DISTANCE_M / SPEED_OF_LIGHT_M_PER_S
    h = (
        -(antenna.broadside_amplitude**2)
        * chirp.wavelengths_m
        / (8 * np.pi * MIRROR_DISTANCE_M)
        * np.exp(phase)
    )
    return float(signal_power(h[None, :])[0])


def noise_power(
    front_end: FrontEnd, chirp: Chirp, antenna: Antenna, reference_power: float | None = None
) -> float:
    """Thermal noise power of one complex sample, over the transmitted power; 0 without thermal noise.

    Args:
        front_end: states the level.
        chirp: T samples.
        antenna: of the mirror in `mirror_snr_db`.
        reference_power: median of `signal_power` over all rows, for `snr_db`.

    Raises:
        RadarError: `snr_db` is given without a positive reference power.
    """
    if front_end.snr_db is not None:
        if reference_power is None or not (np.isfinite(reference_power) and reference_power > 0):
            raise RadarError(
                f"snr_db needs the signal's power, the median of signal_power over all rows, got {reference_power!r}: "
                "an empty scene has no signal (use mirror_snr_db or noise_figure_db)"
            )
        return chirp.num_samples * reference_power * _ratio(-front_end.snr_db)
    if front_end.mirror_snr_db is not None:
        return chirp.num_samples * mirror_power(chirp, antenna) * _ratio(-front_end.mirror_snr_db)
    if front_end.noise_figure_db is not None:
        assert front_end.transmit_power_dbm is not None and front_end.sample_rate_hz is not None
        received_w = BOLTZMANN_J_PER_K * REFERENCE_TEMPERATURE_K * front_end.sample_rate_hz
        transmitted_w = 1e-3 * _ratio(front_end.transmit_power_dbm)
        return received_w * _ratio(front_end.noise_figure_db) / transmitted_w
    return 0.0


def thermal_noise(power: float, num_samples: int, first: int, stop: int, seed: int) -> NDArray[np.complex64]:
    """White circular Gaussian noise of rows first .. stop - 1, independent for every pair, shape (n, T)."""

    def draw(rng: np.random.Generator, count: int) -> NDArray[np.complex64]:
        parts = rng.standard_normal((count, 2 * num_samples), dtype=np.float32)
        return parts.view(np.complex64)

    return np.asarray(draw_rows(seed, "thermal noise", first, stop, draw) * np.float32(np.sqrt(power / 2)))


def _ratio(level_db: float) -> float:
    return float(10.0 ** (level_db / 10.0))
