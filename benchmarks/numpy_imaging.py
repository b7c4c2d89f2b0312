"""Imaging programs in NumPy that the compiled kernel is compared with.

`plain` is written as the formula reads; `direct` and `factorised` are written for speed, in single
precision. Monostatic; Eq. 1: I(v) = sum_n sum_t h[n, t] exp(+j 4 pi f_t R_nv / c).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from waveformer.simulator.imaging import GridBlock
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, reference_phase
from waveformer.simulator.subapertures import Tile

ZERO_PADDING = 8
_CELLS_AT_A_TIME = 256


def range_profiles(h: Any, chirp: Chirp) -> Any:
    """Profiles over range, freed of the carrier at the centre frequency; (N, ZERO_PADDING * T) complex64."""
    count = ZERO_PADDING * chirp.num_samples
    profiles = np.fft.ifft(h, n=count, axis=1) * count
    range_m = np.arange(count) * chirp.range_bin_m / ZERO_PADDING
    carrier = np.exp(4j * np.pi * (chirp.start_hz - chirp.center_hz) / SPEED_OF_LIGHT_M_PER_S * range_m)
    return (profiles * carrier).astype(np.complex64)


def plain(profiles: Any, voxels_m: Any, chirp: Chirp, tx_m: Any) -> Any:
    """`direct` in double precision, line by line as the formula reads."""
    wavenumber = 2.0 * np.pi * chirp.center_hz / SPEED_OF_LIGHT_M_PER_S
    range_m = np.arange(profiles.shape[1]) * chirp.range_bin_m / ZERO_PADDING
    image = np.zeros(len(voxels_m), dtype=np.complex128)
    for profile, antenna in zip(profiles, tx_m, strict=True):
        distance_m = np.linalg.norm(voxels_m - antenna, axis=1)
        image += np.interp(distance_m, range_m, profile) * np.exp(2j * wavenumber * distance_m)
    return image


def direct(profiles: Any, voxels_m: Any, chirp: Chirp, tx_m: Any) -> Any:
    """Voxel by voxel: the profile between its two nearest points, times the exact carrier; (V,) complex64."""
    step_m = chirp.range_bin_m / ZERO_PADDING
    wavenumber = 4.0 * np.pi * chirp.center_hz / SPEED_OF_LIGHT_M_PER_S
    center = voxels_m.mean(axis=0)
    points = np.ascontiguousarray((voxels_m - center).T, dtype=np.float32)
    squares = (points**2).sum(axis=0)
    image = np.zeros(len(voxels_m), dtype=np.complex64)
    for profile, antenna in zip(profiles, tx_m - center, strict=True):
        distance = float(np.linalg.norm(antenna))
        difference = squares - 2.0 * (antenna.astype(np.float32) @ points)
        excess = difference / (np.sqrt(difference + np.float32(distance**2)) + np.float32(distance))
        place = excess * np.float32(1.0 / step_m) + np.float32(distance / step_m)
        low = place.astype(np.int32)
        place -= low
        left = profile[low]
        value = left + place * (profile[low + 1] - left)
        phase = excess * np.float32(wavenumber) + np.float32(wavenumber * distance % (2.0 * np.pi))
        carrier = np.empty_like(value)
        np.cos(phase, out=carrier.real)
        np.sin(phase, out=carrier.imag)
        value *= carrier
        image += value
    return image


def factorised(block: GridBlock, tile: Tile, h: Any, chirp: Chirp, aperture: Aperture) -> Any:
    """The stages of the compiled kernel for one tile and a block of equally full cells; (V,) complex64."""
    ranges, num_cells = block.ranges, len(block.centers_m)
    antennas = aperture.tx_m[tile.rows] - ranges.center_m
    centers = block.centers_m - ranges.center_m
    focused = h[tile.rows] * reference_phase(chirp, aperture, tile.rows, ranges.center_m).conj()
    bins = (focused @ ranges.to_samples.conj().T).reshape(len(tile.rows), ranges.count, NUM_MOMENTS)
    moments = _cells_from_bins(bins, block, _excess(antennas, centers.T))
    if tile.weights is not None:
        weights = tile.weights.T.astype(np.complex64)
        moments = np.stack([weights @ moment for moment in moments])
    nodes = tile.node_tx_m - ranges.center_m
    to_centers = _excess(nodes, centers.T)
    points = (block.offsets_m + centers[block.cell]).reshape(num_cells, -1, 3).astype(np.float32)
    image = np.zeros(points.shape[:2], dtype=np.complex64)
    wavenumber, scale = np.float32(4.0 * np.pi / ranges.wavelength_m), np.float32(1.0 / ranges.moment_scale_m)
    for start in range(0, num_cells, _CELLS_AT_A_TIME):
        part = slice(start, start + _CELLS_AT_A_TIME)
        some = np.ascontiguousarray(points[part].reshape(-1, 3).T)
        squares = (some**2).sum(axis=0)
        for node, antenna in enumerate(nodes):
            excess = _excess(antenna[None], some, squares).reshape(image[part].shape)
            excess -= to_centers[node, part, None]
            a, b, c, d = moments[:, node, part, None]
            phase = excess * wavenumber
            carrier = np.empty(phase.shape, dtype=np.complex64)
            np.cos(phase, out=carrier.real)
            np.sin(phase, out=carrier.imag)
            excess *= scale
            value = excess * d
            for lower in (c, b):
                value += lower
                value *= excess
            value += a
            value *= carrier
            image[part] += value
    return image.reshape(-1)


def _cells_from_bins(bins: Any, block: GridBlock, excess: Any) -> Any:
    """Adjoint moments of every antenna and cell, shape (NUM_MOMENTS, n, Q)."""
    ranges = block.ranges
    nearest = np.rint(excess * np.float32(1.0 / ranges.width_m))
    x = (excess - nearest * np.float32(ranges.width_m)) * np.float32(1.0 / ranges.moment_scale_m)
    index = nearest.astype(np.int32) + ranges.count // 2
    row = np.arange(len(bins))[:, None]
    m0, m1, m2, m3 = (np.ascontiguousarray(bins[..., i])[row, index] for i in range(NUM_MOMENTS))
    phase = excess * np.float32(4.0 * np.pi / ranges.wavelength_m)
    carrier = np.cos(phase) + 1j * np.sin(phase)
    shifted = np.stack(
        [m0 + x * (m1 + x * (m2 + x * m3)), m1 + x * (2 * m2 + 3 * x * m3), m2 + 3 * x * m3, m3]
    )
    return shifted * carrier


def _excess(antennas: Any, points: Any, squares: Any = None) -> Any:
    """Range to points (3, P) minus range to the origin, shape (n, P), float32."""
    antennas, points = antennas.astype(np.float32), points.astype(np.float32, copy=False)
    square = (antennas**2).sum(axis=1)[:, None]
    difference = ((points**2).sum(axis=0) if squares is None else squares) - 2.0 * (antennas @ points)
    return difference / (np.sqrt(square + difference) + np.sqrt(square))
