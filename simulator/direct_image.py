"""Eq. 1 and the field of normals, voxel by voxel and antenna by antenna: the exact twin of `focus`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.focusing import Focus, normals_of, summed_axes
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.runtime import activate

# Linear interpolation between range samples so close errs by (pi step / range bin)^2 / 8: 1e-3 for 5 cm bins.
_STEP_M = 1.5e-3
_ANTENNAS_PER_LAUNCH = 2048


def direct_image(measurement: Measurement, grid: Grid, *, normals: bool = True) -> Focus:
    """Image of a scan, and its normals, without any factorisation.

    Args:
        measurement: h of shape (N, T); its known range bias is taken out.
        grid: voxels, as many as fit into memory.
        normals: whether to find normals, too.

    Raises:
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    activate()
    import drjit as dr

    from waveformer.simulator.backend import Float
    from waveformer.simulator.device import to_device_vectors
    from waveformer.simulator.kernel_direct_image import add_antennas

    chirp, aperture = measurement.chirp, measurement.aperture
    points = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1).reshape(-1, 3)
    voxels = to_device_vectors(points)
    axes = summed_axes(measurement) if normals else ()
    sums = [dr.zeros(Float, len(points)) for _ in range(2 + 2 * len(axes))]
    corners = points[[0, -1]]
    for first in range(0, len(aperture), _ANTENNAS_PER_LAUNCH):
        rows = slice(first, first + _ANTENNAS_PER_LAUNCH)
        sides = [aperture.tx_m[rows]] if aperture.rx_m is None else [aperture.tx_m[rows], aperture.rx_m[rows]]
        nearest_m, farthest_m = _range_span(corners, sides)
        ranges_m = np.arange(nearest_m - _STEP_M, farthest_m + 2.0 * _STEP_M, _STEP_M)
        profiles = _profiles(measurement, rows, ranges_m)
        wavelength_m = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
        sums = add_antennas(sums, voxels, sides, profiles, float(ranges_m[0]), _STEP_M, wavelength_m)
    values = np.stack([value.numpy() for value in sums])
    image = (values[0] + 1j * values[1]).reshape(grid.shape)
    return Focus(grid, image, normals_of(measurement, grid, values, axes) if normals else None)


def _range_span(corners_m: NDArray[np.float64], sides: list[NDArray[np.float64]]) -> tuple[float, float]:
    """Shortest and longest way between any antenna and a box."""
    antennas = np.concatenate(sides)
    low, high = corners_m
    outside = np.maximum(0.0, np.maximum(low - antennas, antennas - high))
    farthest = np.maximum(np.abs(antennas - low), np.abs(antennas - high))
    return float(np.linalg.norm(outside, axis=1).min()), float(np.linalg.norm(farthest, axis=1).max())


def _profiles(measurement: Measurement, rows: slice, ranges_m: NDArray[np.float64]) -> NDArray[np.complex64]:
    """sum_t h[n, t] exp(+j 4 pi (f_t - f_c) r / c) at the given ranges, known bias taken out, shape (n, R)."""
    chirp = measurement.chirp
    offsets_hz = chirp.frequencies_hz - chirp.center_hz
    steering = np.exp(4j * np.pi * offsets_hz[:, None] * ranges_m / SPEED_OF_LIGHT_M_PER_S)
    return np.asarray((measurement.h[rows] * measurement.bias_correction) @ steering, dtype=np.complex64)
