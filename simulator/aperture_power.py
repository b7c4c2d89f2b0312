"""What a coarse search compares: the power of an echo over place in the aperture, direction and range.

Sub-apertures are beamformed on their own and only their magnitudes are kept, so nothing turns with half a
wavelength: the misfit varies over millimetres and degrees, where that of the signal varies over tenths. The same as a
smoothed Wigner distribution (Husimi) of the wavefront; zero padding keeps its directions free of alias minima.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft

# Power far below the mean counts as noise, in units of the mean.
_FLOOR = 0.02


class AperturePower:
    """Compares amplitudes of sub-apertures with those of a measured signal.

    Args:
        measured: signal on a grid of antennas at M equispaced frequencies, shape (num_y, num_x, M).
        size: antennas along the edge of a sub-aperture.
        hop: antennas from one sub-aperture to the next.
    """

    def __init__(self, measured: NDArray[Any], size: int, hop: int) -> None:
        self._shape, self._size, self._hop = measured.shape, size, hop
        window = np.hanning(size + 2)[1:-1]
        nodes = np.arange(measured.shape[2])
        taper = np.hamming(len(nodes)) if len(nodes) > 2 else np.ones(len(nodes))
        self._window = np.outer(window, window).astype(np.float32)
        self._to_range = (np.exp(2j * np.pi * np.outer(nodes, nodes) / len(nodes)) * taper[:, None]).astype(
            np.complex64
        )
        power = np.abs(self._beams(measured.reshape(1, -1, len(nodes)))[0]) ** 2
        self._floor = _FLOOR * float(power.mean())
        self._target = np.sqrt(power + self._floor)
        self._norm = float(np.linalg.norm(self._target - np.sqrt(self._floor)))

    def misfits(self, signals: NDArray[Any]) -> NDArray[np.float64]:
        """Squared residuals of signals (P, N, M) over the square of the measured amplitudes, shape (P,)."""
        return np.array([float(residual @ residual) for residual in map(self.residual, signals)])

    def residual(self, signal: NDArray[Any]) -> NDArray[np.float32]:
        """Differences of amplitudes for a signal (N, M), N antennas in the order of the grid."""
        return np.asarray(self._difference(np.abs(self._beams(signal[None])[0]) ** 2))

    def linearise(
        self, signal: NDArray[Any], columns: NDArray[Any]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Residual (K,) and its derivatives (K, D) for a signal (N, M) with derivatives (N, M, D)."""
        beams = self._beams(signal[None])[0]
        moved = self._beams(np.moveaxis(columns, -1, 0))
        power = np.abs(beams) ** 2
        slopes = (beams.conj() * moved).real / (np.sqrt(power + self._floor) * self._norm)
        return self._difference(power), np.asarray(slopes.T)

    def _difference(self, power: NDArray[Any]) -> NDArray[np.float32]:
        return np.asarray((np.sqrt(power + self._floor) - self._target) / self._norm)

    def _beams(self, signals: NDArray[Any]) -> NDArray[np.complex64]:
        """Complex amplitude of every sub-aperture, direction and range for signals (P, N, M), shape (P, K)."""
        grid = signals.astype(np.complex64, copy=False).reshape(-1, *self._shape)
        cut = sliding_window_view(grid, (self._size, self._size), axis=(1, 2))
        parts = np.moveaxis(cut[:, :: self._hop, :: self._hop], 3, -1) * self._window[..., None]
        parts = parts @ self._to_range
        beams = fft.fft2(parts, (2 * self._size, 2 * self._size), axes=(3, 4))
        return np.asarray(beams).reshape(len(signals), -1)
