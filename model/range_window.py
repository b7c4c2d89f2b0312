"""The few range bins in which a measured signal is compared with a simulated one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

# mmNorm compares the bins with 0.35 <= range <= 0.55 m, half of MITO's bias of the path included.
_MMNORM_RANGE_M = (0.35, 0.55)
_MITO_HALF_BIAS_M = 0.075


@dataclass(frozen=True, eq=False)
class RangeWindow:
    """Range bins of every antenna; bin b lies at b * spacing_m + offset_m, one-way, without the range bias.

    Attributes:
        bins: neighbouring bins, ascending, shape (n, W).
        spacing_m: of the bins, c / (2 B).
        offset_m: of bin 0.
    """

    bins: NDArray[np.int64]
    spacing_m: float
    offset_m: float = 0.0

    def take(self, rows: NDArray[np.int64]) -> RangeWindow:
        """The window of some of the antennas."""
        return RangeWindow(self.bins[rows], self.spacing_m, self.offset_m)

    def lattice(self) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Range of every bin that some antenna uses, shape (U,), and which of them every antenna uses (n, W)."""
        first = int(self.bins.min())
        count = int(self.bins.max()) - first + 1
        index = np.arange(first, first + count, dtype=np.float64)
        return np.asarray(index * self.spacing_m + self.offset_m), self.bins - first


def object_window(chirp: Chirp, near_m: NDArray[np.float64], far_m: NDArray[np.float64]) -> RangeWindow:
    """The bins that the object may fill, and one more at either end.

    Args:
        chirp: T samples.
        near_m, far_m: range of the object's nearest and farthest point from every antenna, shape (n,).

    Returns:
        As many bins for every antenna, at most T.
    """
    first = np.floor(near_m / chirp.range_bin_m).astype(np.int64) - 1
    last = np.ceil(far_m / chirp.range_bin_m).astype(np.int64) + 1
    count = min(int((last - first).max()) + 1, chirp.num_samples)
    return RangeWindow(first[:, None] + np.arange(count), chirp.range_bin_m)


def mmnorm_window(chirp: Chirp, num_antennas: int) -> RangeWindow:
    """The four bins of mmNorm: 0.325, 0.375, 0.425 and 0.474 m with MITO's chirp, whatever the object.

    Raises:
        RadarError: the chirp is too coarse to have two bins there.
    """
    low, high = (
        int(rounding(edge / chirp.range_bin_m))
        for rounding, edge in zip((np.ceil, np.floor), _MMNORM_RANGE_M, strict=True)
    )
    if high <= low:
        raise RadarError(
            f"mmNorm's window of 0.35 to 0.55 m holds no two range bins of {chirp.range_bin_m:.3g} m: "
            'use window "object"'
        )
    bins = np.tile(np.arange(low, high + 1), (num_antennas, 1))
    return RangeWindow(bins, chirp.range_bin_m, -_MITO_HALF_BIAS_M)


def measured_profiles(
    measurement: Measurement, rows: NDArray[np.int64], window: RangeWindow
) -> NDArray[np.complex64]:
    """Range profile of the scan in the bins of the window, its known range bias taken out.

    (1 / T) sum_t h_t exp(+j 2 pi f_t b / c) exp(+j 4 pi (f_t - f_c) r / c): an echo a exp(-j 4 pi f_t R / c)
    gives a exp(-2 j k_c R) D(R - r) with `dirichlet`'s D.

    Args:
        measurement: N antennas.
        rows: those wanted, shape (n,).
        window: of these rows.

    Returns:
        Shape (n, W).
    """
    chirp = measurement.chirp
    range_m, column = window.lattice()
    offset = 4.0 * np.pi * (chirp.frequencies_hz - chirp.center_hz) / SPEED_OF_LIGHT_M_PER_S
    matrix = measurement.bias_correction[:, None] * np.exp(1j * offset[:, None] * range_m) / chirp.num_samples
    profile = measurement.h[rows] @ matrix.astype(np.complex64)
    return np.asarray(np.take_along_axis(profile, column, axis=1))


def dirichlet(chirp: Chirp, distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """What an echo of unit amplitude shows in a bin at this distance: (1 / T) sum_t cos(4 pi (f_t - f_c) d / c)."""
    # the sum of a geometric series; u is half the phase between neighbouring samples
    u = 2.0 * np.pi * chirp.bandwidth_hz / chirp.num_samples / SPEED_OF_LIGHT_M_PER_S * np.asarray(distance_m)
    sine = np.sin(u)
    turns = np.round(u / np.pi)
    near = np.abs(u - turns * np.pi) < 1e-7
    value = np.sin(chirp.num_samples * u) / np.where(near, 1.0, chirp.num_samples * sine)
    return np.asarray(np.where(near, np.cos(np.pi * turns * (chirp.num_samples - 1)), value))
