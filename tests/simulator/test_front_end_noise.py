"""Thermal noise: each way to state its level, recovered from range profiles."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.closed_forms import infinite_plane, point_scatterer
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.front_end_noise import mirror_power, noise_power, signal_power, thermal_noise
from waveformer.simulator.radar import Aperture, Chirp

CHIRP = Chirp(77e9, 4e9, 64)
ROWS = 2000
APERTURE = Aperture(np.zeros((ROWS, 3)))
# In the middle of bin 10, so that its echo leaves the bins used for the noise empty (-60 dB).
RANGE_M = 10 * CHIRP.range_bin_m
NOISE_BINS = slice(24, 58)
ISOTROPIC = Antenna.isotropic()


def echo(rcs_m2: float = 1e-3) -> np.ndarray:
    return np.broadcast_to(point_scatterer(rcs_m2, RANGE_M, RANGE_M, CHIRP.frequencies_hz), (ROWS, 64))


def decibels(ratio: float) -> float:
    return float(10 * np.log10(ratio))


def profile_power(h: np.ndarray) -> np.ndarray:
    return np.asarray(np.abs(np.fft.ifft(h, axis=1)) ** 2)


@pytest.mark.parametrize("snr_db", [12.0, 20.0, 35.0])
def test_snr_is_recovered_from_signal_and_noise_bins(snr_db: float) -> None:
    recorded = apply_front_end(FrontEnd(snr_db=snr_db), echo(), 0, APERTURE, CHIRP, seed=1)
    power = profile_power(recorded)
    noise = power[:, NOISE_BINS].mean()
    # the strongest bin holds noise too
    signal = np.median(power.max(axis=1)) - noise
    # 68,000 noise values give 0.02 dB; the median of 2000 at 12 dB another 0.06 dB
    assert decibels(signal / noise) == pytest.approx(snr_db, abs=0.15)


def test_mirror_snr_does_not_depend_on_the_object() -> None:
    mirror = infinite_plane(0.4, CHIRP.frequencies_hz)
    strongest = float(profile_power(mirror[None]).max())
    for rcs_m2 in (1e-3, 1e-6):
        recorded = apply_front_end(FrontEnd(mirror_snr_db=30.0), echo(rcs_m2), 0, APERTURE, CHIRP, seed=1)
        noise = profile_power(recorded)[:, NOISE_BINS].mean()
        assert decibels(strongest / noise) == pytest.approx(30.0, abs=0.06)


def test_mirror_sees_the_gain_of_both_antennas() -> None:
    with_gain = mirror_power(CHIRP, Antenna.cosine_power(10.5, 56.0, 28.0))
    assert decibels(with_gain / mirror_power(CHIRP, ISOTROPIC)) == pytest.approx(21.0)
    mirror = infinite_plane(0.4, CHIRP.frequencies_hz)
    assert mirror_power(CHIRP, ISOTROPIC) == pytest.approx(float(signal_power(mirror[None])[0]), rel=1e-12)


def test_link_budget_is_kt_times_bandwidth_times_noise_figure() -> None:
    front_end = FrontEnd(noise_figure_db=15.0, transmit_power_dbm=12.0, sample_rate_hz=10e6)
    recorded = apply_front_end(front_end, 0 * echo(), 0, APERTURE, CHIRP, seed=1)
    # -173.98 dBm/Hz is k T at 290 K
    expected = -173.98 + 15.0 + 70.0 - 12.0
    assert decibels(float((np.abs(recorded) ** 2).mean())) == pytest.approx(expected, abs=0.05)


def test_published_radar_sees_the_mirror_80_decibels_above_its_noise() -> None:
    # 12 dBm, 10 dBi, 15 dB and 51.2 us: the estimate in the literature on this radar is about 80 dB
    chirp, antenna = Chirp.from_preset("mito"), Antenna.isotropic(10.0)
    per_bin = noise_power(FrontEnd.from_preset("iwr1443"), chirp, antenna) / chirp.num_samples
    assert decibels(mirror_power(chirp, antenna) / per_bin) == pytest.approx(80.0, abs=1.0)


def test_noise_is_white_circular_and_independent_between_rows() -> None:
    noise = thermal_noise(2.0, 64, 0, ROWS, seed=0)
    # 128,000 numbers: one standard deviation of a mean square is 0.3 %
    assert (np.abs(noise) ** 2).mean() == pytest.approx(2.0, rel=0.01)
    assert abs((noise**2).mean()) < 0.02
    assert abs((noise[:, 1:] * noise[:, :-1].conj()).mean()) < 0.02
    assert abs((noise[1:] * noise[:-1].conj()).mean()) < 0.02


def test_signal_power_is_that_of_the_strongest_bin() -> None:
    tone = 0.3 * np.exp(-2j * np.pi * 7 * np.arange(64) / 64)
    between = 0.3 * np.exp(-2j * np.pi * 7.5 * np.arange(64) / 64)
    powers = signal_power(np.stack([tone, between]))
    assert powers[0] == pytest.approx(0.09)
    # half a bin off: the Dirichlet kernel, 3.9 dB lower
    assert powers[1] == pytest.approx(0.09 / (64 * np.sin(np.pi / 128)) ** 2)


def test_snr_needs_a_signal() -> None:
    with pytest.raises(RadarError, match="empty scene"):
        apply_front_end(FrontEnd(snr_db=20.0), 0 * echo(), 0, APERTURE, CHIRP, seed=0)
    with pytest.raises(RadarError, match="signal's power"):
        apply_front_end(FrontEnd(snr_db=20.0), echo()[:100], 0, APERTURE, CHIRP, seed=0)
    assert noise_power(FrontEnd(), CHIRP, ISOTROPIC) == 0.0
