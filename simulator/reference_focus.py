"""Image and normals as they are defined, in float64: the twin of `focus` and `direct_image`."""

from __future__ import annotations

import numpy as np

from waveformer.simulator.focusing import Focus
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S


def dense_focus(measurement: Measurement, grid: Grid) -> Focus:
    """Eq. 1 and mmNorm's votes: every voxel, antenna and sample by itself; memory is antennas times voxels."""
    voxels = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1).reshape(-1, 3)
    tx, rx = measurement.aperture.tx_m, measurement.aperture.receivers_m
    contributions = np.empty((len(tx), len(voxels)), dtype=np.complex128)
    for row, (a, b) in enumerate(zip(tx, rx, strict=True)):
        path_m = np.linalg.norm(voxels - a, axis=1) + np.linalg.norm(voxels - b, axis=1)
        path_m = path_m + measurement.range_bias_m
        turns = path_m[:, None] * measurement.chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
        contributions[row] = np.exp(2j * np.pi * turns) @ measurement.h[row]
    image = contributions.sum(axis=0)
    votes = (contributions * image.conj()).real / np.abs(image)
    antennas = 0.5 * (tx + rx)
    normals = np.einsum("kv,kvi->vi", votes, antennas[:, None] - voxels[None])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    image = image.astype(np.complex64)
    return Focus(grid, image.reshape(grid.shape), normals.astype(np.float32).reshape(*grid.shape, 3))
