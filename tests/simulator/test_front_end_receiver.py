"""Mixer, interference and converter: each parameter from the signal alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.front_end_settings import Adc, DcOffset, Interferer, IqImbalance
from waveformer.simulator.radar import Aperture, Chirp

CHIRP = Chirp(77.5e9, 3e9, 512)
RATE_HZ = 10e6
OWN_SLOPE = CHIRP.bandwidth_hz / (512 / RATE_HZ)


def recorded(h: np.ndarray, seed: int = 0, **settings: Any) -> np.ndarray:
    aperture = Aperture(np.zeros((len(h), 3)))
    return apply_front_end(FrontEnd(**settings), h, 0, aperture, CHIRP, seed)


def tone(bin_number: int, amplitude: complex = 0.01) -> np.ndarray:
    return np.asarray(amplitude * np.exp(-2j * np.pi * bin_number * np.arange(512) / 512)[None])


def silence(rows: int) -> np.ndarray:
    return np.zeros((rows, 512), dtype=np.complex64)


@pytest.mark.parametrize(("gain_db", "phase_deg"), [(0.5, 3.0), (-1.0, 0.0), (0.0, -8.0)])
def test_imbalance_is_recovered_from_the_image_of_a_tone(gain_db: float, phase_deg: float) -> None:
    h = recorded(
        tone(40, 0.01 * np.exp(0.7j)), iq_imbalance=IqImbalance(gain_db=gain_db, phase_deg=phase_deg)
    )
    profile = np.fft.ifft(h[0].astype(complex))
    # image over conjugate echo: beta / conj(alpha) = (1 - e) / (1 + e), e = g exp(-j phi)
    ratio = profile[-40] / profile[40].conjugate()
    error = (1 - ratio) / (1 + ratio)
    # single precision
    assert 20 * np.log10(abs(error)) == pytest.approx(gain_db, abs=1e-4)
    assert -np.degrees(np.angle(error)) == pytest.approx(phase_deg, abs=1e-3)


def test_imbalance_acts_on_q_alone() -> None:
    h = tone(40)
    unequal = recorded(h, iq_imbalance=IqImbalance(gain_db=6.0))
    # single precision
    assert np.abs(unequal.real - h.real).max() < 2e-9
    assert np.abs(unequal.imag - h.imag * 10 ** (6 / 20)).max() < 4e-9


def test_dc_offset_is_the_mean_of_the_samples() -> None:
    h = recorded(tone(33), dc_offset=DcOffset(level_db=-50.0, phase_deg=120.0))
    mean = h.astype(complex).mean()
    assert 20 * np.log10(abs(mean)) == pytest.approx(-50.0, abs=1e-4)
    assert np.degrees(np.angle(mean)) == pytest.approx(120.0, abs=1e-3)


@pytest.mark.parametrize("bits", [4, 8, 12, 16])
def test_bits_are_recovered_from_the_step_and_the_range(bits: int, rng: np.random.Generator) -> None:
    loud = 0.4 * (rng.standard_normal((400, 512)) + 1j * rng.standard_normal((400, 512)))
    h = recorded(loud, adc=Adc(bits=bits, full_scale_db=-6.0))
    values = np.unique(np.concatenate([h.real.ravel(), h.imag.ravel()]))
    step = np.diff(values).min()
    assert np.log2(-values[0] / step) == pytest.approx(bits - 1, abs=1e-2)
    assert 20 * np.log10(-values[0]) == pytest.approx(-6.0, abs=1e-5)
    # the largest code is one less than full scale
    assert values[-1] == pytest.approx(-values[0] - step, rel=1e-6)


def test_quantisation_error_is_a_twelfth_of_the_squared_step_in_each_component(
    rng: np.random.Generator,
) -> None:
    quiet = 0.1 * (rng.standard_normal((200, 512)) + 1j * rng.standard_normal((200, 512)))
    adc = Adc(bits=8, full_scale_db=0.0)
    error = recorded(quiet, adc=adc) - quiet
    assert adc.step == 1 / 128
    # 205,000 errors, uniform: 0.2 %; 3 of these
    assert (np.abs(error) ** 2).mean() == pytest.approx(2 * adc.step**2 / 12, rel=0.006)
    assert np.abs(error.real).max() <= adc.step / 2 * (1 + 1e-5)


def test_a_signal_beyond_full_scale_is_clipped_and_a_quantised_one_stays() -> None:
    adc = Adc(bits=10, full_scale_db=-20.0)
    h = recorded(tone(10, 0.5), adc=adc)
    assert h.real.max() == pytest.approx(0.1 - adc.step)
    assert h.real.min() == pytest.approx(-0.1)
    assert (recorded(h, adc=adc) == h).all()


INTERFERER = Interferer(slope_hz_per_s=50e12, level_db=-55.0, filter_hz=4e6, crossing_s=20e-6)


def test_interferer_slope_level_time_and_filter_are_recovered() -> None:
    h = recorded(silence(3), sample_rate_hz=RATE_HZ, interferer=INTERFERER).astype(complex)
    level = np.abs(h[0])
    # near the crossing alone, where the beat is slow enough for its phase to be followed
    near = slice(198, 203)
    phase = np.unwrap(np.angle(h[:, near]), axis=1)
    time_s = np.arange(512)[near] / RATE_HZ
    for row in phase:
        curvature, rate, _ = np.polyfit(time_s - 20e-6, row, 2)
        assert OWN_SLOPE + curvature / np.pi == pytest.approx(INTERFERER.slope_hz_per_s, rel=1e-3)
        assert -rate / (2 * curvature) == pytest.approx(0.0, abs=1e-9)
    assert 20 * np.log10(level.max()) == pytest.approx(-55.0, abs=1e-4)
    # the slopes differ by 8.6 THz/s: 4 MHz last 0.465 us, four samples to either side of the crossing
    assert np.flatnonzero(level > level.max() * np.sqrt(0.5)).tolist() == list(range(196, 205))
    # and 26 MHz are 6.4 times the filter's width, to the power of 8
    assert level[230:].max() < 1e-6 * level.max()


def test_width_of_the_anti_alias_filter_is_recovered_from_the_length_of_the_burst() -> None:
    # 0.2 THz/s faster than the own chirp: the burst lasts 2 x 4 MHz / 0.2 THz/s = 40 us
    slow = INTERFERER.model_copy(update={"slope_hz_per_s": OWN_SLOPE + 0.2e12, "crossing_s": 25e-6})
    h = recorded(silence(1), sample_rate_hz=RATE_HZ, interferer=slow)
    half_power = (np.abs(h[0]) > np.abs(h[0]).max() * np.sqrt(0.5)).sum() / RATE_HZ
    # to one sample at either end
    assert half_power * 0.2e12 / 2 == pytest.approx(4e6, abs=0.2e12 / RATE_HZ)


def test_unsynchronised_interferer_crosses_at_any_time_with_any_phase() -> None:
    loose = INTERFERER.model_copy(update={"crossing_s": None, "slope_hz_per_s": OWN_SLOPE + 2e12})
    h = recorded(silence(2000), sample_rate_hz=RATE_HZ, interferer=loose)
    middle = (np.abs(h) ** 2 * np.arange(512)).sum(axis=1) / (np.abs(h) ** 2).sum(axis=1)
    assert np.histogram(middle, bins=4, range=(0, 512))[0] == pytest.approx(500, abs=80)
    fixed = recorded(silence(2000), sample_rate_hz=RATE_HZ, interferer=INTERFERER)[:, 200]
    # 2000 random phases: the mean vector is 0.022 long
    assert abs((fixed / np.abs(fixed)).mean()) < 0.07
