"""Phase noise: its spectrum from the residual phase, range correlation, and many delays at once."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.arrays import with_receivers
from waveformer.simulator.closed_forms import point_scatterer
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.front_end_oscillator import OscillatorPhase, with_phase_noise
from waveformer.simulator.front_end_settings import Interferer, Leakage, PhaseNoise
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

CHIRP = Chirp(77.5e9, 3e9, 512)
RATE_HZ = 10e6
ROWS = 1500
APERTURE = Aperture(np.zeros((ROWS, 3)))
NOISE = PhaseNoise(level_dbc_hz=-90.0, offset_hz=1e6, loop_hz=200e3)
FRONT_END = FrontEnd(phase_noise=NOISE, sample_rate_hz=RATE_HZ)


def tone(bin_number: int) -> np.ndarray:
    """An echo in the middle of a bin, of constant amplitude."""
    return np.exp(-2j * np.pi * bin_number * np.arange(512) / 512)[None]


def phase_density(recorded: np.ndarray, clean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and two-sided power spectral density of the phase by which two signals differ."""
    phase = np.angle(recorded * clean.conj())
    window = np.hanning(512)
    spectrum = np.fft.rfft(phase * window, axis=1)
    density = (np.abs(spectrum) ** 2).mean(axis=0) / (RATE_HZ * (window**2).sum())
    return np.fft.rfftfreq(512, 1 / RATE_HZ), density


def level_near(offsets: np.ndarray, density: np.ndarray, offset_hz: float, width_hz: float) -> float:
    near = np.abs(offsets - offset_hz) < width_hz
    return float(10 * np.log10(density[near].mean()))


def test_level_and_slope_are_recovered_from_the_residual_phase_of_a_far_echo() -> None:
    bin_number = 300
    clean = np.broadcast_to(tone(bin_number), (ROWS, 512))
    recorded = apply_front_end(FRONT_END, clean, 0, APERTURE, CHIRP, seed=2)
    offsets, density = phase_density(recorded, clean)
    delay_s = bin_number / CHIRP.bandwidth_hz
    with np.errstate(divide="ignore", invalid="ignore"):
        own = density / (4 * np.sin(np.pi * offsets * delay_s) ** 2)
    # 1500 rows x 5 independent lines: 0.05 dB; the Hann window smears a slope of 20 dB a decade by 0.03 dB
    assert level_near(offsets, own, 1e6, 50e3) == pytest.approx(-90.0, abs=0.25)
    # 4 MHz is 12.04 dB lower outside the loop: (1 + 400) / (1 + 25) = 11.88 dB with a loop of 200 kHz
    assert level_near(offsets, own, 4e6, 50e3) == pytest.approx(-90.0 - 11.88, abs=0.25)
    # at the edge of the loop half of the plateau, which is 26 times the level at 1 MHz
    assert level_near(offsets, own, 200e3, 25e3) == pytest.approx(-90.0 + 10 * np.log10(26 / 2), abs=0.4)


def test_near_echoes_keep_little_of_it() -> None:
    near, far = (
        phase_density(apply_front_end(FRONT_END, clean, 0, APERTURE, CHIRP, seed=2), clean)[1]
        for clean in (np.broadcast_to(tone(bin_number), (ROWS, 512)) for bin_number in (8, 160))
    )
    ratio = 10 * np.log10(near[20:40].sum() / far[20:40].sum())
    # sin(pi f tau) is nearly proportional to the delay below 0.8 MHz and 53 ns: 1 / 20 squared. Its curvature
    # takes 0.05 dB, single precision of the phase adds to the near one 0.03 dB
    assert ratio == pytest.approx(-26.02, abs=0.15)


def test_leakage_without_delay_has_none_and_an_interferer_all_of_it() -> None:
    silence = np.zeros((ROWS, 512), dtype=np.complex64)
    leak = FRONT_END.model_copy(update={"leakage": Leakage(level_db=-40.0)})
    recorded = apply_front_end(leak, silence, 0, APERTURE, CHIRP, seed=0)
    assert np.abs(recorded - 0.01).max() < 1e-8

    # an interferer of almost the own slope is a tone that lasts for the whole chirp
    slope = CHIRP.bandwidth_hz / (512 / RATE_HZ)
    interferer = Interferer(slope_hz_per_s=slope * (1 + 1e-9), level_db=-40.0, filter_hz=4e6, crossing_s=0.0)
    radar = FRONT_END.model_copy(update={"interferer": interferer})
    recorded = apply_front_end(radar, silence, 0, APERTURE, CHIRP, seed=0)
    clean = apply_front_end(
        radar.model_copy(update={"phase_noise": None}), silence, 0, APERTURE, CHIRP, seed=0
    )
    offsets, density = phase_density(recorded, clean)
    assert level_near(offsets, density, 1e6, 50e3) == pytest.approx(-90.0, abs=0.25)


@pytest.mark.parametrize(("num_samples", "largest"), [(512, 0.01), (64, 0.05)])
def test_echoes_of_many_delays_at_once(num_samples: int, largest: float, rng: np.random.Generator) -> None:
    chirp = Chirp(77e9, 4e9, num_samples)
    ranges_m = rng.uniform(0.3, 0.7, size=12)
    rows = np.arange(20)
    phase = OscillatorPhase(NOISE, RATE_HZ, num_samples, rows, seed=0)
    clean, noisy = np.zeros((2, 20, num_samples), dtype=complex)
    for range_m in ranges_m:
        echo = point_scatterer(1e-3, range_m, range_m, chirp.frequencies_hz)
        clean += echo
        noisy += echo * np.exp(1j * phase.residual(np.full(20, 2 * range_m / SPEED_OF_LIGHT_M_PER_S)))
    error = np.linalg.norm(with_phase_noise(clean.astype(np.complex64), phase, chirp) - noisy)
    # of the noise itself: up to ten bins between the echoes, differences of five samples, and of two at the ends
    assert error / np.linalg.norm(noisy - clean) < largest


def test_receivers_of_a_chirp_share_it_and_chirps_do_not() -> None:
    pairs = with_receivers(Aperture.planar_grid(3, 1, 0.01), "mito")
    clean = np.broadcast_to(tone(100), (12, 512))
    recorded = apply_front_end(FRONT_END, clean, 0, pairs, CHIRP, seed=0)
    by_chirp = recorded.reshape(3, 4, 512)
    assert (by_chirp == by_chirp[:, :1]).all()
    assert np.abs(by_chirp[0, 0] - by_chirp[1, 0]).max() > 1e-4
