"""Backprojection with MITO's arithmetic, bin for bin, to compare with its published code; not for imaging.

Its range transform is zero-padded eightfold and read at the bin below, which turns the phase by up to 0.4 rad; its carrier
is that of the lowest frequency; and the bins are spaced with c = 3e8 m/s. `focus` and `backproject` do without.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement

_PADDING = 8
_ROUNDED_SPEED_M_PER_S = 3e8


def floor_bin_image(
    measurement: Measurement, grid: Grid, *, bandwidth_hz: float | None = None
) -> NDArray[np.complex128]:
    """Image of a scan as MITO's imager computes it, for signals of this project's sign; float64, slow.

    Args:
        measurement: h of shape (N, T); its known range bias is added to every path, as there.
        grid: voxels.
        bandwidth_hz: what the bins are spaced with; MITO's 3.0009e9 differs from T times its slope by 5e-6. Default is
            the chirp's.

    Returns:
        Complex image, shape (X, Y, Z), not normalised.
    """
    chirp, aperture = measurement.chirp, measurement.aperture
    if not np.isfinite(measurement.h).all():
        raise RadarError("h holds non-finite samples: image only what was recorded whole")
    count = _PADDING * chirp.num_samples
    # an unnormalised inverse transform: signals of this project turn the other way than the recordings
    profiles = np.fft.ifft(measurement.h.astype(np.complex128), count, axis=1) * count
    bin_m = _ROUNDED_SPEED_M_PER_S / (2.0 * (bandwidth_hz or chirp.bandwidth_hz)) / _PADDING
    image = np.zeros(grid.shape, dtype=np.complex128)
    voxels = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1)
    for tx_m, rx_m, profile in zip(aperture.tx_m, aperture.receivers_m, profiles, strict=True):
        path_m = np.linalg.norm(voxels - tx_m, axis=-1) + np.linalg.norm(voxels - rx_m, axis=-1)
        path_m = path_m + measurement.range_bias_m
        bins = np.floor(path_m / (2.0 * bin_m)).astype(np.int64)
        recorded = (bins >= 0) & (bins < count)
        carrier = np.exp(2j * np.pi * path_m / chirp.wavelengths_m[0])
        image += np.where(recorded, profile[np.clip(bins, 0, count - 1)], 0.0) * carrier
    return image
