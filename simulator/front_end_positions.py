"""Where the antennas really were: position jitter and one depth error for each raster row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_streams import draw_rows, generator
from waveformer.simulator.radar import Aperture

# Positions whose y differ by less belong to one raster row: far below any row spacing, far above rounding.
_SAME_ROW_M = 1e-6


def true_aperture(front_end: FrontEnd, aperture: Aperture, seed: int) -> Aperture:
    """The antennas at the places where the signal was recorded; the measurement keeps the nominal ones.

    Transmitter and receivers of a position move together.

    Args:
        front_end: gives the standard deviations.
        aperture: nominal antennas, N pairs.
        seed: of the simulation.

    Returns:
        Aperture of the same N pairs; `aperture` itself if positions are exact.
    """
    if not front_end.position_jitter_m and not front_end.row_depth_error_m:
        return aperture
    shift_m = np.zeros((len(aperture), 3))
    if front_end.position_jitter_m:
        normals = draw_rows(
            seed, "position jitter", 0, len(aperture), lambda rng, count: rng.standard_normal((count, 3))
        )
        shift_m += front_end.position_jitter_m * normals[chirp_leaders(aperture, 0, len(aperture))]
    if front_end.row_depth_error_m:
        rows = raster_rows(aperture)
        normals = generator(seed, "row depth error").standard_normal(rows.max() + 1)
        shift_m[:, 2] += front_end.row_depth_error_m * normals[rows]
    rx = None if aperture.rx_m is None else aperture.rx_m + shift_m
    return Aperture(aperture.tx_m + shift_m, rx)


def raster_rows(aperture: Aperture) -> NDArray[np.intp]:
    """Number of the raster row of every pair, counted along y, shape (N,)."""
    y = np.round(aperture.tx_m[:, 1] / _SAME_ROW_M)
    return np.unique(y, return_inverse=True)[1]


def chirp_leaders(aperture: Aperture, first: int, stop: int) -> NDArray[np.intp]:
    """For each of the rows first .. stop - 1 the row of the first receiver of its chirp, shape (stop - first,).

    Receivers of one chirp are consecutive rows with one transmitter position. A new chirp begins where the
    transmitter moves, or where the receiver is the first of its chirp again.
    """
    if aperture.rx_m is None:
        return np.arange(first, stop)
    start = first
    while start > 0 and (aperture.tx_m[start] == aperture.tx_m[start - 1]).all():
        start -= 1
    tx, rx = aperture.tx_m[start:stop], aperture.rx_m[start:stop]
    begins = np.ones(len(tx), dtype=bool)
    begins[1:] = (tx[1:] != tx[:-1]).any(axis=1)
    begins |= (rx == rx[_last_true(begins)]).all(axis=1)
    return start + _last_true(begins)[first - start :]


def _last_true(flags: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Index of the last true flag up to and including each."""
    return np.maximum.accumulate(np.where(flags, np.arange(len(flags)), 0))
