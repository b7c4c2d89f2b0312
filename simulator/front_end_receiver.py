"""What happens to a received signal between mixer and memory: interference, I/Q imbalance, DC offset, ADC."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.front_end_settings import Adc, DcOffset, Interferer, IqImbalance
from waveformer.simulator.front_end_streams import draw_rows
from waveformer.simulator.radar import Chirp

_FILTER_ORDER = 8

ComplexArray = NDArray[np.complex64]


def interfering_chirp(
    interferer: Interferer, chirp: Chirp, sample_rate_hz: float, leaders: NDArray[np.intp], seed: int
) -> ComplexArray:
    """Another radar's chirp after the mixer and the anti-alias filter, shape (n, T).

    The beat frequency (slope' - slope) (t - crossing) gives the phase pi (slope' - slope) (t - crossing)^2.

    Args:
        interferer: slope, level, filter and crossing time.
        chirp: the own chirp.
        sample_rate_hz: of the complex samples.
        leaders: first row of the chirp of every row (`chirp_leaders`), shape (n,), increasing.
        seed: of the simulation.
    """
    first = int(leaders[0])
    uniform = draw_rows(
        seed, "interferer", first, int(leaders[-1]) + 1, lambda rng, count: rng.random((count, 2))
    )[leaders - first]
    duration_s = chirp.num_samples / sample_rate_hz
    crossing_s = uniform[:, :1] * duration_s if interferer.crossing_s is None else interferer.crossing_s
    slope = interferer.slope_hz_per_s - chirp.bandwidth_hz / duration_s
    since_s = np.arange(chirp.num_samples) / sample_rate_hz - crossing_s
    passed = 1.0 / np.sqrt(1.0 + (slope * since_s / interferer.filter_hz) ** (2 * _FILTER_ORDER))
    amplitude = 10.0 ** (interferer.level_db / 20.0)
    phase = np.pi * slope * since_s**2 + 2 * np.pi * uniform[:, 1:]
    return np.asarray(amplitude * passed * np.exp(1j * phase), dtype=np.complex64)


def with_iq_imbalance(h: ComplexArray, imbalance: IqImbalance) -> ComplexArray:
    """The signal with its image, alpha h + beta conj(h)."""
    error = 10.0 ** (imbalance.gain_db / 20.0) * np.exp(1j * np.radians(imbalance.phase_deg))
    alpha, beta = np.complex64((1 + error) / 2), np.complex64((1 - error.conjugate()) / 2)
    return np.asarray(alpha * h + beta * h.conj())


def dc_level(offset: DcOffset) -> np.complex64:
    """The constant that is added to every sample."""
    return np.complex64(10.0 ** (offset.level_db / 20.0) * np.exp(1j * np.radians(offset.phase_deg)))


def quantised(h: ComplexArray, adc: Adc) -> ComplexArray:
    """The signal as a recording holds it: whole codes within full scale, back in units of h."""
    largest = 2 ** (adc.bits - 1)
    parts = np.ascontiguousarray(h).view(np.float32) / np.float32(adc.step)
    codes = np.clip(np.rint(parts), -largest, largest - 1)
    return np.asarray((codes * np.float32(adc.step)).view(np.complex64))
