"""Clutter, leakage and range bias: each parameter from the signal alone."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.arrays import with_receivers
from waveformer.simulator.closed_forms import infinite_plane, point_scatterer
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.front_end_echoes import room_echo, room_points, table_echo
from waveformer.simulator.front_end_settings import Leakage, RoomClutter, TableClutter
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

CHIRP = Chirp(77e9, 4e9, 60)
GRID = Aperture.planar_grid(4, 3, 0.05)
SILENCE = np.zeros((len(GRID), 60), dtype=np.complex64)
ISOTROPIC = Antenna.isotropic()
ROOM = RoomClutter(count=40, rcs_m2=2e-4, min_m=(-0.1, -0.1, -1.6), max_m=(0.1, 0.1, -1.4))


def relative(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


def path_m(h: np.ndarray) -> np.ndarray:
    """Path length from the slope of the phase over frequency."""
    phase = np.unwrap(np.angle(h.astype(complex)), axis=-1)
    slope = np.polynomial.polynomial.polyfit(CHIRP.frequencies_hz - 79e9, np.atleast_2d(phase).T, 1)[1]
    return np.asarray(-slope * SPEED_OF_LIGHT_M_PER_S / (2 * np.pi))


def test_table_is_the_mirror_of_the_closed_form() -> None:
    table = FrontEnd(table=TableClutter(z_m=-0.45, reflection=-0.3))
    recorded = apply_front_end(table, SILENCE, 0, GRID, CHIRP, seed=0)
    # single precision
    assert relative(recorded, infinite_plane(0.45, CHIRP.frequencies_hz, -0.3)[None]) < 3e-6


def test_table_reflection_and_height_are_recovered_for_antenna_pairs() -> None:
    pairs = with_receivers(GRID, [[0.3, 0.1, 0.0], [-0.02, 0.0, 0.05]])
    recorded = table_echo(TableClutter(z_m=-0.5, reflection=0.2), pairs, CHIRP, ISOTROPIC)
    # the image law: the straight line from the transmitter's image to the receiver
    path = np.sqrt(np.tile([0.1 + 1.0**2, 0.02**2 + 1.05**2], len(GRID)))
    assert path_m(recorded) == pytest.approx(path, abs=1e-5)
    level = np.abs(recorded) * 4 * np.pi * path[:, None] / CHIRP.wavelengths_m
    assert level == pytest.approx(0.2, rel=1e-5)


def test_table_sees_the_antennas_at_the_angle_of_the_mirror_point() -> None:
    antenna = Antenna.cosine_power(10.0, 60.0, 30.0)
    pair = Aperture([[0.0, 0.0, 0.0]], [[0.4, 0.0, 0.0]])
    table = TableClutter(z_m=-0.5, reflection=-1.0)
    ratio = table_echo(table, pair, CHIRP, antenna) / table_echo(table, pair, CHIRP, ISOTROPIC)
    # at equal heights the mirror point lies half way, 0.2 m to the side and 0.5 m below both
    one_way = antenna.amplitude([0.2, 0.0, 0.5])
    assert np.abs(ratio) == pytest.approx(float(one_way) ** 2, rel=1e-5)
    # at unequal heights the way divides in proportion to them
    uneven = Aperture([[0.0, 0.0, 0.0]], [[0.4, 0.0, 0.5]])
    ratio = table_echo(table, uneven, CHIRP, antenna) / table_echo(table, uneven, CHIRP, ISOTROPIC)
    out, back = antenna.amplitude([-0.4 / 3, 0.0, 0.5]), antenna.amplitude([0.8 / 3, 0.0, 1.0])
    assert np.abs(ratio) == pytest.approx(float(out * back), rel=1e-5)


def test_table_above_the_antennas_is_refused() -> None:
    with pytest.raises(RadarError, match="below"):
        table_echo(TableClutter(z_m=0.1, reflection=-1.0), GRID, CHIRP, ISOTROPIC)


@pytest.mark.parametrize("chirp", [CHIRP, Chirp(77e9, 4e9, 64), Chirp(77e9, 4e9, 5)], ids=["60", "64", "5"])
def test_room_is_the_sum_of_its_scatterers(chirp: Chirp) -> None:
    antenna = Antenna.from_preset("iwr1443")
    pairs = with_receivers(GRID, "mito")
    expected = np.zeros((len(pairs), chirp.num_samples), dtype=complex)
    for point in room_points(ROOM, seed=5):
        out, back = pairs.tx_m - point, pairs.receivers_m - point
        gains = antenna.amplitude(out) * antenna.amplitude(back)
        ways = (np.linalg.norm(way, axis=1)[:, None] for way in (out, back))
        expected += gains[:, None] * point_scatterer(ROOM.rcs_m2, *ways, chirp.frequencies_hz)
    # 40 terms in single precision
    assert relative(room_echo(ROOM, pairs, chirp, antenna, seed=5), expected) < 3e-6


def test_total_cross_section_of_the_room_is_recovered_from_the_mean_power() -> None:
    room = FrontEnd(room=ROOM)
    wide = Aperture.planar_grid(8, 8, 0.1)
    silence = np.zeros((len(wide), 60), dtype=np.complex64)
    power = np.mean(
        [np.abs(apply_front_end(room, silence, 0, wide, CHIRP, seed)) ** 2 for seed in range(30)], axis=(0, 2)
    )
    ranges = np.linalg.norm(wide.tx_m - [0, 0, -1.5], axis=1)
    wavelength = CHIRP.wavelengths_m.mean()
    total = power * (4 * np.pi) ** 3 * ranges**4 / wavelength**2
    # Rayleigh fading of 30 rooms seen from 64 positions of 0.1 m, where the speckle of a box of 0.2 m at 1.5 m is
    # 15 mm: 1920 independent powers, 2.3 %; and the spread of 1/R^4 over the box adds 1 %
    assert total.mean() == pytest.approx(ROOM.count * ROOM.rcs_m2, rel=0.08)


def test_room_stands_still_and_fills_its_box() -> None:
    points = room_points(ROOM, seed=0)
    assert points.shape == (40, 3)
    assert (points >= ROOM.min_m).all()
    assert (points <= ROOM.max_m).all()
    assert np.ptp(points, axis=0).min() > 0.15
    assert (room_points(ROOM, seed=0) == points).all()
    assert (room_points(ROOM, seed=1) != points).all()


def test_leakage_level_and_path_are_recovered_from_what_all_positions_share(rng: np.random.Generator) -> None:
    recorded = apply_front_end(
        FrontEnd(leakage=Leakage(level_db=-65.0, path_m=0.03)), SILENCE, 0, GRID, CHIRP, seed=0
    )
    common = recorded.mean(axis=0)
    assert 20 * np.log10(np.abs(common)) == pytest.approx(-65.0, abs=1e-4)
    assert path_m(common)[0] == pytest.approx(0.03, abs=1e-5)
    # 3 cm of path are 0.4 of a bin: the echo peaks in the first one
    assert (np.abs(np.fft.ifft(recorded, axis=1)).argmax(axis=1) == 0).all()


def test_range_bias_is_recovered_from_the_slope_of_the_phase() -> None:
    distance = np.linalg.norm(GRID.tx_m - [0, 0, -0.4], axis=1)[:, None]
    echo = point_scatterer(1e-3, distance, distance, CHIRP.frequencies_hz)
    recorded = apply_front_end(FrontEnd(range_bias_m=0.15), echo, 0, GRID, CHIRP, seed=0)
    assert path_m(recorded) - 2 * distance[:, 0] == pytest.approx(0.15, abs=1e-5)
    expected = echo * np.exp(-2j * np.pi * CHIRP.frequencies_hz * 0.15 / SPEED_OF_LIGHT_M_PER_S)
    assert relative(recorded, expected) < 1e-6
