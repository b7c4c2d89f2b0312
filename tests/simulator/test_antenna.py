"""Antenna patterns against their formulas, and the sampled cuts against the pattern."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from waveformer.simulator.antenna import Antenna, AntennaCuts
from waveformer.simulator.errors import RadarError

ANGLES = np.array([-90.0, -40.0, -10.0, 0.0, 15.0, 50.0, 90.0])
TABLE = Antenna.table(ANGLES, [-20, 0, 9, 10, 8, -2, -30], [-25, -5, 8, 10, 9, -4, -20])
BOARD = Antenna.from_preset("iwr1443")


def gain_db(antenna: Antenna, *directions: Any) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(antenna.amplitude(np.array(directions, dtype=float))))


def towards(theta_x_deg: float, theta_y_deg: float) -> np.ndarray:
    """A vector from the scene to the antenna with the given angles in the two planes."""
    return np.array([np.tan(np.radians(theta_x_deg)), np.tan(np.radians(theta_y_deg)), 1.0])


def interpolated(cuts: AntennaCuts, direction: np.ndarray) -> np.ndarray:
    """What a kernel makes of the cuts."""
    angles = np.linspace(-90, 90, len(cuts.amplitude_x))
    x, y = (np.degrees(np.arctan2(direction[..., i], direction[..., 2])) for i in (0, 1))
    both = np.interp(x, angles, cuts.amplitude_x) * np.interp(y, angles, cuts.amplitude_y)
    return np.where(direction[..., 2] > 0, both / cuts.broadside, 0.0)


def test_isotropic_antenna_has_its_gain_everywhere(rng: np.random.Generator) -> None:
    antenna = Antenna.isotropic(7.0)
    assert antenna.is_isotropic
    assert gain_db(antenna, *rng.normal(size=(20, 3))) == pytest.approx(7.0)
    assert Antenna.isotropic().amplitude(np.zeros((4, 5, 3))).shape == (4, 5)


def test_cosine_power_loses_three_decibels_at_half_its_beamwidth_in_each_plane() -> None:
    antenna = Antenna.cosine_power(12.0, 60.0, 30.0)
    half_power = 10 * np.log10(0.5)
    assert not antenna.is_isotropic
    assert gain_db(antenna, [0, 0, 1])[0] == pytest.approx(12.0)
    for sign in (-1, 1):
        assert gain_db(antenna, towards(30 * sign, 0))[0] == pytest.approx(12.0 + half_power)
        assert gain_db(antenna, towards(0, 15 * sign))[0] == pytest.approx(12.0 + half_power)
        assert gain_db(antenna, towards(30 * sign, 15))[0] == pytest.approx(12.0 + 2 * half_power)


def test_cosine_power_is_a_power_of_the_cosine() -> None:
    exponent = np.log(0.5) / np.log(np.cos(np.radians(30)))
    expected = 10 * exponent * np.log10(np.cos(np.radians([10, 45, 80])))
    measured = gain_db(Antenna.cosine_power(0.0, 60.0, 60.0), *(towards(angle, 0) for angle in (10, 45, 80)))
    assert measured == pytest.approx(expected)


def test_the_vector_points_from_the_scene_to_the_antenna() -> None:
    # the radar looks down: a point below it sends up, +z, and a point above it lies behind the antenna
    below, above = np.array([0.0, 0.0, -0.4]), np.array([0.0, 0.0, 0.4])
    for antenna in (BOARD, TABLE):
        assert antenna.amplitude(np.zeros(3) - below) == pytest.approx(antenna.broadside_amplitude)
        assert antenna.amplitude(np.zeros(3) - above) == 0.0
        assert antenna.amplitude(np.array([1.0, 0.0, 0.0])) == 0.0


@pytest.mark.parametrize("antenna", [BOARD, TABLE], ids=["cosine", "table"])
def test_the_length_of_the_vector_does_not_matter(antenna: Antenna, rng: np.random.Generator) -> None:
    direction = rng.normal(size=(30, 3)) + [0, 0, 2]
    assert antenna.amplitude(3.7 * direction) == pytest.approx(antenna.amplitude(direction), rel=1e-12)


def test_table_gives_its_own_values_and_their_sum_off_the_planes() -> None:
    assert gain_db(TABLE, towards(-40, 0), towards(0, -40)) == pytest.approx([0, -5])
    assert gain_db(TABLE, towards(15, 0), towards(0, 50)) == pytest.approx([8, -4])
    assert gain_db(TABLE, towards(15, 50))[0] == pytest.approx(8 - 4 - 10)
    assert gain_db(TABLE, towards(5, 0))[0] == pytest.approx(
        10 - 2 / 3
    )  # linear in dB between 0 and 15 degrees


def test_table_keeps_its_last_value_up_to_the_horizon() -> None:
    narrow = Antenna.table([-30, 0, 30], [2, 6, 3], [1, 6, 2])
    assert gain_db(narrow, towards(70, 0), towards(-70, 0)) == pytest.approx([3, 2])


def test_cuts_that_differ_a_little_at_broadside_meet_at_their_mean() -> None:
    antenna = Antenna.table([-30, 0, 30], [2, 6.2, 3], [1, 6.0, 2])
    assert gain_db(antenna, [0, 0, 1])[0] == pytest.approx(6.1)
    assert gain_db(antenna, towards(30, 0))[0] == pytest.approx(2.9)


@pytest.mark.parametrize("antenna", [BOARD, TABLE], ids=["cosine", "table"])
def test_sampled_cuts_make_the_pattern(antenna: Antenna, rng: np.random.Generator) -> None:
    direction = rng.normal(size=(5000, 3)) + [0, 0, 1]
    cuts = antenna.cuts()
    assert len(cuts.amplitude_x) == len(cuts.amplitude_y) == round(180 / cuts.step_deg) + 1
    error = np.abs(interpolated(cuts, direction) - antenna.amplitude(direction)) / antenna.broadside_amplitude
    # cos^(n/2) with n = 23 (28 degrees): curvature 11.5 times (0.25 degrees)^2 / 8 = 3e-5, in each plane
    assert error.max() < 6e-5


def test_the_board_has_the_published_gain_and_widths() -> None:
    half_power = 10 * np.log10(0.5)
    assert gain_db(BOARD, [0, 0, 1])[0] == pytest.approx(10.5)
    assert gain_db(BOARD, towards(28, 0), towards(0, 14)) == pytest.approx([10.5 + half_power] * 2)


@pytest.mark.parametrize(
    "antenna", [Antenna.isotropic(3.0), BOARD, TABLE], ids=["isotropic", "cosine", "table"]
)
def test_description_is_plain_json(antenna: Antenna) -> None:
    described = antenna.describe()
    assert json.loads(json.dumps(described)) == described
    assert described["gain_dbi"] == antenna.gain_dbi


@pytest.mark.parametrize(
    "make",
    [
        lambda: Antenna.isotropic(np.nan),
        lambda: Antenna.cosine_power(10, 0.0, 30.0),
        lambda: Antenna.cosine_power(10, 30.0, 180.0),
        lambda: Antenna.cosine_power("10", 30.0, 30.0),  # type: ignore[arg-type]
        lambda: Antenna.table([0, 1], [0, 1], [0, 1, 2]),
        lambda: Antenna.table([0], [0], [0]),
        lambda: Antenna.table([1, 2], [0, 0], [0, 0]),
        lambda: Antenna.table([-5, -5, 5], [0, 0, 0], [0, 0, 0]),
        lambda: Antenna.table([-5, 0, 5], [0, 10, 0], [0, 9, 0]),
        lambda: Antenna.table([-5, 0, 5], [0, np.inf, 0], [0, 9, 0]),
        lambda: BOARD.cuts(0.7),
        lambda: BOARD.cuts(0.0),
    ],
)
def test_nonsense_is_refused(make: Any) -> None:
    with pytest.raises(RadarError):
        make()


def test_an_unknown_board_names_the_known_ones() -> None:
    with pytest.raises(RadarError, match="iwr1443"):
        Antenna.from_preset("iwr9999")
