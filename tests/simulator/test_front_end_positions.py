"""Where the antennas really were, recovered from the phase of a point's echo."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.arrays import with_receivers
from waveformer.simulator.closed_forms import point_scatterer
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_positions import chirp_leaders, raster_rows, true_aperture
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

CHIRP = Chirp(77e9, 4e9, 16)
WAVENUMBER = 2 * np.pi * CHIRP.frequencies_hz[0] / SPEED_OF_LIGHT_M_PER_S


def excess_m(aperture: Aperture, point: list[float], nominal: Aperture) -> np.ndarray:
    """Change of the mean of both ways, from the phase of the first sample alone."""
    ways = [
        [np.linalg.norm(antennas - point, axis=1) for antennas in (a.tx_m, a.receivers_m)]
        for a in (aperture, nominal)
    ]
    recorded, expected = (point_scatterer(1e-3, out, back, CHIRP.frequencies_hz[0]) for out, back in ways)
    return np.asarray(-np.angle(recorded / expected) / (2 * WAVENUMBER))


@pytest.mark.parametrize("direction", [[0, 0, -1], [1, 0, 0], [0, -1, 0], [0.6, 0, -0.8]])
def test_jitter_is_recovered_from_the_phase_in_every_direction(direction: list[float]) -> None:
    nominal = Aperture(np.zeros((4000, 3)))
    moved = true_aperture(FrontEnd(position_jitter_m=1e-4), nominal, seed=3)
    error = excess_m(moved, list(0.5 * np.array(direction)), nominal)
    # the standard deviation of 4000 numbers is known to 1.1 %; 3 of these
    assert error.std() == pytest.approx(1e-4, rel=0.034)
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.05


def test_depth_error_is_one_number_per_row_and_recovered() -> None:
    nominal = Aperture.planar_grid(3, 3000, (1e-6, 1e-5))
    moved = true_aperture(FrontEnd(row_depth_error_m=2e-4), nominal, seed=0)
    error = excess_m(moved, [0.0, 0.0, -0.4], nominal).reshape(3000, 3)
    # a tenth of a micrometre: the point stands 15 mm off the axis of the outer rows
    assert np.ptp(error, axis=1).max() < 1e-7
    # of 3000 rows the standard deviation is known to 1.3 %; 3 of these
    assert error[:, 0].std() == pytest.approx(2e-4, rel=0.04)


def test_rows_of_a_raster_scan_are_its_lines_of_equal_y_whichever_way_they_run() -> None:
    raster = Aperture.raster_rows(0.02, 5, step_m=0.005, row_spacing_m=0.004, center_m=(0.1, 0.2, 0.3))
    assert (raster_rows(raster) == np.repeat(np.arange(5), 5)).all()


def test_transmitter_and_receivers_of_a_position_move_together() -> None:
    nominal = with_receivers(Aperture.planar_grid(5, 4, 0.003), "mito")
    moved = true_aperture(FrontEnd(position_jitter_m=1e-4, row_depth_error_m=3e-4), nominal, seed=7)
    shift = moved.tx_m - nominal.tx_m
    assert moved.receivers_m - nominal.receivers_m == pytest.approx(shift, abs=1e-15)
    by_position = shift.reshape(20, 4, 3)
    assert (by_position == by_position[:, :1]).all()
    assert len(np.unique(by_position[:, 0, 0])) == 20


def test_exact_positions_are_the_nominal_ones_and_the_seed_decides_the_others() -> None:
    nominal = Aperture.planar_grid(4, 4, 0.003)
    assert true_aperture(FrontEnd(snr_db=3.0), nominal, seed=0) is nominal
    jitter = FrontEnd(position_jitter_m=1e-4)
    first, again, other = (true_aperture(jitter, nominal, seed).tx_m for seed in (0, 0, 1))
    assert (first == again).all()
    assert (first != other).all()


def test_leaders_mark_the_first_receiver_of_each_chirp() -> None:
    single = Aperture.planar_grid(3, 1, 0.01)
    assert chirp_leaders(single, 1, 3).tolist() == [1, 2]
    pairs = with_receivers(single, "mito")
    leaders = np.repeat([0, 4, 8], 4)
    assert (chirp_leaders(pairs, 0, 12) == leaders).all()
    for first, stop in [(3, 9), (5, 6), (4, 12)]:
        assert (chirp_leaders(pairs, first, stop) == leaders[first:stop]).all()


def test_a_position_measured_twice_has_two_chirps() -> None:
    pairs = with_receivers(Aperture(np.zeros((3, 3))), "mito")
    assert (chirp_leaders(pairs, 0, 12) == np.repeat([0, 4, 8], 4)).all()
    assert chirp_leaders(pairs, 6, 7).tolist() == [4]
    assert chirp_leaders(Aperture(np.zeros((3, 3))), 0, 3).tolist() == [0, 1, 2]
