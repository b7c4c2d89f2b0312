"""Chirps and apertures: frequencies, ranges, presets, orders of positions, and what is refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from waveformer.simulator.errors import RadarError
from waveformer.simulator.presets import APERTURE_PRESETS, CHIRP_PRESETS, RASTER_PRESETS
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

CHIRP = Chirp(77e9, 4e9, 256)


def test_sample_frequencies_start_at_the_start_and_leave_the_end_point_out() -> None:
    assert CHIRP.frequencies_hz[0] == 77e9
    assert CHIRP.frequencies_hz[-1] == 81e9 - 4e9 / 256
    assert np.diff(CHIRP.frequencies_hz) == pytest.approx(4e9 / 256)


def test_wavelengths_fall_while_the_frequency_rises() -> None:
    assert CHIRP.wavelengths_m * CHIRP.frequencies_hz == pytest.approx(SPEED_OF_LIGHT_M_PER_S)
    assert CHIRP.wavelengths_m.shape == (256,)


def test_center_is_the_middle_of_the_sampled_frequencies() -> None:
    assert CHIRP.center_hz == pytest.approx(CHIRP.frequencies_hz.mean(), rel=1e-14)
    # half a step below the middle of the swept band, whose end point is not sampled
    assert CHIRP.center_hz == pytest.approx(79e9 - 0.5 * 4e9 / 256, rel=1e-14)


def test_range_bin_is_c_over_two_bandwidths_and_the_unambiguous_range_holds_one_per_sample() -> None:
    assert CHIRP.range_bin_m == pytest.approx(299_792_458.0 / 8e9)
    assert CHIRP.unambiguous_range_m == pytest.approx(256 * CHIRP.range_bin_m)


def test_an_echo_beyond_the_unambiguous_range_repeats_an_echo_one_range_nearer() -> None:
    near_m = 0.4
    far_m = near_m + CHIRP.unambiguous_range_m
    relative_hz = CHIRP.frequencies_hz - CHIRP.frequencies_hz[0]
    near, far = (np.exp(-4j * np.pi * relative_hz * r / SPEED_OF_LIGHT_M_PER_S) for r in (near_m, far_m))
    assert np.abs(near - far).max() < 1e-9  # float64 at phases of 1e3 rad


def test_mito_preset_is_the_published_band() -> None:
    chirp = Chirp.from_preset("mito")
    assert (chirp.start_hz, chirp.num_samples) == (77.5001e9, 512)
    assert chirp.bandwidth_hz == 3.0009e9
    # Published as 5 861 160 Hz a sample, while the rounded bandwidth over 512 is 5 861 132.8125 Hz:
    # 5 ppm apart: 14 kHz over the band, which turns the phase by 0.2 mrad at 0.3 m and 15 mrad at 25 m.
    assert np.diff(chirp.frequencies_hz).mean() == pytest.approx(5_861_132.8125)
    assert np.diff(chirp.frequencies_hz).mean() == pytest.approx(5_861_160, rel=5e-6)


@pytest.mark.parametrize("name", CHIRP_PRESETS)
def test_every_chirp_preset_is_a_valid_chirp(name: str) -> None:
    assert dataclasses.asdict(Chirp.from_preset(name)) == CHIRP_PRESETS[name]


@pytest.mark.parametrize("name", APERTURE_PRESETS)
def test_every_aperture_preset_is_a_monostatic_grid_about_the_origin(name: str) -> None:
    aperture = Aperture.from_preset(name)
    assert len(aperture) == APERTURE_PRESETS[name]["num_x"] * APERTURE_PRESETS[name]["num_y"]
    assert aperture.is_monostatic
    assert aperture.tx_m.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    assert not aperture.tx_m[:, 2].any()


@pytest.mark.parametrize("name", RASTER_PRESETS)
def test_every_raster_preset_is_a_monostatic_scan_about_the_origin(name: str) -> None:
    aperture = Aperture.from_preset(name)
    assert len(aperture) % RASTER_PRESETS[name]["num_rows"] == 0
    assert aperture.is_monostatic
    assert aperture.tx_m.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-12)
    assert not aperture.tx_m[:, 2].any()


def test_the_quarter_wave_grid_is_the_one_of_mitos_simulator() -> None:
    aperture = Aperture.from_preset("mito_quarter_wave")
    assert len(aperture) == 130_640
    quarter_wave_m = SPEED_OF_LIGHT_M_PER_S / Chirp.from_preset("mito").start_hz / 4
    assert aperture.tx_m[1] - aperture.tx_m[0] == pytest.approx([quarter_wave_m, 0, 0], abs=1e-12)
    assert aperture.tx_m[230] - aperture.tx_m[0] == pytest.approx([0, quarter_wave_m, 0], abs=1e-12)
    # Published to the millimetre as count times pitch.
    extent_m = np.ptp(aperture.tx_m, axis=0) + quarter_wave_m
    assert extent_m[:2] == pytest.approx([0.222, 0.549], abs=5e-4)


def test_the_raster_keeps_what_the_recordings_say() -> None:
    aperture = Aperture.from_preset("mito_raster")
    assert len(aperture) == pytest.approx(44_000, rel=0.01)  # published as "about 44 000"
    assert np.ptp(aperture.tx_m, axis=0) == pytest.approx([0.30, 0.40, 0.0], abs=1e-12)
    steps_m = np.linalg.norm(np.diff(aperture.tx_m, axis=0), axis=1)
    least_m = 3 / 16 * SPEED_OF_LIGHT_M_PER_S / 77.5001e9
    frame_pitch_m = 0.30 / 4000  # one row is one file of 4000 frames
    assert least_m <= steps_m.min() < least_m + frame_pitch_m
    assert not aperture.tx_m[400, 1] - aperture.tx_m[0, 1]
    assert aperture.tx_m[401, 1] > aperture.tx_m[400, 1]


def test_an_unknown_preset_lists_the_known_ones() -> None:
    with pytest.raises(RadarError, match="unknown radar preset 'x-band'; known: mito, 77-81ghz, 24ghz"):
        Chirp.from_preset("x-band")
    with pytest.raises(
        RadarError, match=r"unknown aperture preset 'huge'; known: small, mito, single, .*mito_raster"
    ):
        Aperture.from_preset("huge")


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("start_hz", float("nan"), "start_hz must be a positive"),
        ("start_hz", float("inf"), "start_hz must be a positive"),
        ("start_hz", -77e9, "start_hz must be a positive"),
        ("start_hz", "77e9", "start_hz must be a positive"),
        ("start_hz", 77, "77 GHz is 77e9"),
        ("start_hz", 1e13, "outside"),
        ("bandwidth_hz", 0.0, "bandwidth_hz must be a positive"),
        ("bandwidth_hz", float("nan"), "bandwidth_hz must be a positive"),
        ("bandwidth_hz", 78e9, "exceeds start_hz"),
        ("num_samples", 1, "at least 2"),
        ("num_samples", 2.5, "integer"),
        ("num_samples", True, "integer"),
        ("num_samples", None, "integer"),
        ("num_samples", 1 << 21, "2\\^20"),
    ],
)
def test_a_senseless_chirp_is_refused_with_a_reason(field: str, value: Any, says: str) -> None:
    values: dict[str, Any] = {"start_hz": 77e9, "bandwidth_hz": 4e9, "num_samples": 256} | {field: value}
    with pytest.raises(RadarError, match=says):
        Chirp(**values)


@pytest.mark.parametrize(
    "number",
    [
        np.float64(77e9),
        np.float32(77e9),
        np.int64(77_000_000_000),
    ],
)
def test_a_chirp_takes_numpy_numbers(number: Any) -> None:
    # float32 holds 77e9 to 6e-8
    assert Chirp(number, 4e9, 256).frequencies_hz[0] == pytest.approx(77e9, rel=1e-7)


def test_a_chirp_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        CHIRP.start_hz = 1e9  # type: ignore[misc]


def test_the_cached_frequencies_of_a_chirp_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        Chirp(77e9, 4e9, 8).frequencies_hz[0] = 0.0


def test_an_aperture_copies_its_positions_and_is_read_only() -> None:
    positions = np.zeros((2, 3))
    aperture = Aperture(positions, positions + 0.1)
    positions[0, 0] = 1.0
    assert aperture.tx_m[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        aperture.tx_m[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        aperture.tx_m = positions  # type: ignore[misc]


def test_without_receivers_the_aperture_is_monostatic() -> None:
    assert Aperture(np.zeros((2, 3))).receivers_m is not None
    assert Aperture(np.zeros((2, 3))).is_monostatic
    bistatic = Aperture(np.zeros((2, 3)), np.ones((2, 3)))
    assert not bistatic.is_monostatic
    assert (bistatic.receivers_m == 1).all()


@pytest.mark.parametrize(
    ("tx_m", "rx_m", "says"),
    [
        (np.zeros(3), None, r"tx_m must have shape \(N, 3\)"),
        (np.zeros((2, 2)), None, r"tx_m must have shape \(N, 3\)"),
        (np.zeros((0, 3)), None, "N >= 1"),
        ([["a", 0, 0]], None, "must be numbers"),
        ([[np.nan, 0, np.inf]], None, "2 non-finite"),
        (np.zeros((2, 3)), [[0, 0, np.nan]] * 2, "rx_m holds 2 non-finite"),
        (np.zeros((2, 3)), np.zeros((3, 3)), "row by row"),
    ],
)
def test_a_bad_aperture_is_refused_with_a_reason(tx_m: Any, rx_m: Any, says: str) -> None:
    with pytest.raises(RadarError, match=says):
        Aperture(tx_m, rx_m)


def test_planar_grid_runs_x_fastest_about_its_center() -> None:
    aperture = Aperture.planar_grid(3, 2, (0.01, 0.02), center_m=(1.0, 2.0, 0.5))
    expected = [[x, y, 0.5] for y in (1.99, 2.01) for x in (0.99, 1.0, 1.01)]
    assert aperture.tx_m == pytest.approx(np.array(expected), abs=1e-15)


@pytest.mark.parametrize(
    "arguments", [(0, 1, 0.1), (1, -1, 0.1), (2, 2, 0.0), (2, 2, (0.1, -0.1)), (2, 2, float("nan"))]
)
def test_planar_grid_refuses_empty_counts_and_pitches(arguments: Any) -> None:
    with pytest.raises(RadarError, match="positive counts and spacing"):
        Aperture.planar_grid(*arguments)


def test_raster_rows_turn_around_at_the_end_of_every_row() -> None:
    aperture = Aperture.raster_rows(0.02, 3, step_m=0.01, row_spacing_m=0.05, center_m=(0, 0, 1))
    along = [-0.01, 0.0, 0.01, 0.01, 0.0, -0.01, -0.01, 0.0, 0.01]
    assert aperture.tx_m[:, 0] == pytest.approx(np.array(along), abs=1e-15)
    assert aperture.tx_m[:, 1] == pytest.approx(np.repeat([-0.05, 0.0, 0.05], 3), abs=1e-15)
    assert (aperture.tx_m[:, 2] == 1).all()


@pytest.mark.parametrize(
    "change", [{"step_m": 0.0}, {"step_m": 0.3}, {"row_spacing_m": -1.0}, {"num_rows": 0}]
)
def test_raster_rows_refuses_impossible_rows(change: dict[str, Any]) -> None:
    values: dict[str, Any] = {"row_length_m": 0.2, "num_rows": 2, "step_m": 0.01, "row_spacing_m": 0.01}
    with pytest.raises(RadarError, match="raster needs"):
        Aperture.raster_rows(**(values | change))
