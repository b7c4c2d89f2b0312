"""Validation of the radar itself: antenna patterns, and impairments found again in the signal alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waveformer.simulator import primitives
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture
from waveformer.simulator.sphere_series import sphere_echo
from waveformer.simulator.target import Target
from waveformer.simulator.validation_result import (
    MITO_BAND,
    CheckResult,
    ComplexArray,
    Trial,
    level_db,
    placed,
    worst,
)
from waveformer.simulator.validation_signal import range_peak_m

_BALL_RADIUS_M, _BALL_DEPTH_M = 0.02, 0.4
_WHY_SEEDED = "three standard deviations of the estimate from this many draws"


def antenna_pattern(trial: Trial) -> Iterator[CheckResult]:
    """Gain at broadside, and where a data sheet's beamwidth puts the half power, in both planes."""
    depth, antenna = 0.4, Antenna.from_preset("iwr1443")
    speck = Target(primitives.plate(1e-3, 1e-3), pose=placed((0, 0, -depth)))
    edges_deg = (56.0 / 2, 28.0 / 2)
    level = {}
    for axis, edge in enumerate(edges_deg):
        degrees = np.array([0.0, -edge, edge])
        places = np.zeros((3, 3))
        places[:, axis] = depth * np.tan(np.radians(degrees))
        bare = trial.simulate(speck, MITO_BAND, Aperture(places))
        found = level_db(trial.simulate(speck, MITO_BAND, Aperture(places), antenna=antenna) / bare)
        level[f"{'xy'[axis]} broadside"] = worst(found[0] - 21.0)
        level[f"{'xy'[axis]} edges"] = worst(found[1:] - (21.0 + 40 * np.log10(np.sqrt(0.5))))
    yield CheckResult(
        "point behind antennas of 10.5 dBi, half power at 28 and 14 deg", "worst error of the gain G_tx G_rx",
        max(level.values()), 0.01, "dB", "data sheet: 21 dB at broadside, 6.02 dB less at the edge of both beams",
        "single precision and a table in steps of 0.1 deg", trial.mode, detail=level,
    )  # fmt: skip


def thermal_noise_level(trial: Trial) -> Iterator[CheckResult]:
    """`snr_db` is what the range profile shows."""
    asked, count = 20.0, 900
    h = _ball_echo(trial, Aperture.planar_grid(30, 30, 2e-3), FrontEnd(snr_db=asked))
    # The ball lies in bin 8; a taper keeps its sidelobes out of the bins from 20 on
    taper = np.hanning(h.shape[1] + 2)[1:-1]
    noise = (np.abs(np.fft.ifft(h * taper, axis=1)[:, 20:60]) ** 2).mean() / (taper**2).mean()
    strongest = np.median((np.abs(np.fft.ifft(h, axis=1)) ** 2).max(axis=1)) - noise
    yield CheckResult(
        f"ball with snr_db = {asked:g}", f"error of the ratio found in {count} range profiles",
        abs(10 * np.log10(strongest / noise) - asked), 0.1, "dB", "the parameter",
        "36,000 noisy bins are good to 0.02 dB; the rest is the noise on the strongest bin", trial.mode,
    )  # fmt: skip


def range_bias(trial: Trial) -> Iterator[CheckResult]:
    """A known delay inside the radar moves every echo by half of it."""
    bias, radar = 0.15, Aperture(np.zeros((1, 3)))
    shift = range_peak_m(_ball_echo(trial, radar, FrontEnd(range_bias_m=bias))[0], MITO_BAND)
    shift -= _BALL_DEPTH_M - _BALL_RADIUS_M
    yield CheckResult(
        f"ball with range_bias_m = {bias:g}", "error of the bias found in the range profile, of a range bin",
        100 * abs(2 * shift - bias) / MITO_BAND.range_bin_m, 4.0, "%", "the parameter",
        "the peak is good to 2 % of a bin, the bias is twice its shift", trial.mode,
    )  # fmt: skip


def iq_image(trial: Trial) -> Iterator[CheckResult]:
    """Unequal I and Q arms make an image at the mirrored range."""
    gain_db, phase_deg = 0.5, 4.0
    front_end = FrontEnd.model_validate({"iq_imbalance": {"gain_db": gain_db, "phase_deg": phase_deg}})
    h = _ball_echo(trial, Aperture(np.zeros((1, 3))), front_end)[0]
    profile = np.fft.ifft(h * np.blackman(len(h) + 2)[1:-1], 64 * len(h))
    top = int(np.abs(profile).argmax())
    error = 10 ** (gain_db / 20) * np.exp(1j * np.radians(phase_deg))
    asked = (1 - np.conj(error)) / (1 + np.conj(error))
    yield CheckResult(
        f"ball with iq_imbalance of {gain_db:g} dB and {phase_deg:g} deg",
        "complex error of image over conjugate echo, of its magnitude",
        100 * abs(profile[-top] / np.conj(profile[top]) - asked) / abs(asked), 2.0, "%", "Razavi: beta / conj(alpha)",
        "sidelobes of Blackman's window, -70 dB of the echo at the image, which is 27 dB below it", trial.mode,
    )  # fmt: skip


def row_depth_errors(trial: Trial) -> Iterator[CheckResult]:
    """Each raster row lies at a depth of its own, which its echoes' phase gives away."""
    asked, rows, columns = 2e-4, 400, 3
    aperture = Aperture.planar_grid(columns, rows, (2e-3, 0.25e-3))
    h = _ball_echo(trial, aperture, FrontEnd(row_depth_error_m=asked))
    f, center = MITO_BAND.frequencies_hz, np.array([0.0, 0.0, -_BALL_DEPTH_M])
    truth = sphere_echo(_BALL_RADIUS_M, center, aperture.tx_m, None, f[::16])
    k = 2 * np.pi * f[::16] / SPEED_OF_LIGHT_M_PER_S
    steep = _BALL_DEPTH_M / np.linalg.norm(aperture.tx_m - center, axis=1)
    depth = (-np.angle(h[:, ::16] / truth) / (2 * k)).mean(axis=1) / steep
    depth = depth.reshape(rows, columns)
    yield CheckResult(
        f"ball with row_depth_error_m = {1e3 * asked:g} mm", f"error of the standard deviation found over {rows} rows",
        100 * abs(depth.mean(axis=1).std() / asked - 1), 10.6, "%", "the parameter",
        f"{_WHY_SEEDED}: 3 / sqrt(2 x 400)", trial.mode,
    )  # fmt: skip
    yield CheckResult(
        f"ball with row_depth_error_m = {1e3 * asked:g} mm", "largest spread of the depth found within a row",
        1e6 * float(np.ptp(depth, axis=1).max()), 3.0, "um", "one error for each row",
        "3 um is half a degree of phase, what facets differ from the sphere", trial.mode,
    )  # fmt: skip


def _ball_echo(trial: Trial, aperture: Aperture, front_end: FrontEnd) -> ComplexArray:
    ball = Target(primitives.sphere(_BALL_RADIUS_M, 0.7e-3), pose=placed((0, 0, -_BALL_DEPTH_M)))
    return trial.simulate(ball, MITO_BAND, aperture, front_end=front_end, seed=trial.seed)
