"""Forward models in NumPy that the compiled kernel is compared with.

`plain` is written as the formula reads. `direct` and `factorised` are written for speed: single precision,
sine and cosine apart, coordinates apart, nothing recomputed that can be kept, which is about what a careful
programmer gets out of arrays. All serve monostatic apertures and one-sided meshes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from waveformer.simulator.factorisation import Factorisation, TileWork
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, reference_phase

DIRECT_BIN_M = 0.5e-3


class SampleTable:
    """Samples relative to the target's centre, single precision, coordinate by coordinate."""

    def __init__(self, plan: Factorisation, members: Any) -> None:
        points = plan.samples.points_m[members] - plan.ranges.center_m
        normals = plan.samples.normals[members]
        self.points = np.ascontiguousarray(points.T, dtype=np.float32)
        self.normals = np.ascontiguousarray(normals.T, dtype=np.float32)
        self.squares = (points**2).sum(axis=1).astype(np.float32)
        self.heights = (points * normals).sum(axis=1).astype(np.float32)
        self.areas = plan.samples.areas_m2[members].astype(np.float32)
        self.taper = plan.taper[members].astype(np.float32)

    def echo(self, antenna: Any) -> tuple[Any, Any]:
        """Amplitude and range difference of every sample for one antenna."""
        antenna = antenna.astype(np.float32)
        square = antenna @ antenna
        difference = self.squares - 2.0 * (antenna @ self.points)
        range_square = difference + square
        range_m = np.sqrt(range_square)
        cosine = np.maximum((antenna @ self.normals - self.heights) / range_m, np.float32(0.0))
        factor = 1.0 - self.taper * (1.0 - cosine * cosine)
        factor *= factor
        factor *= factor
        return self.areas * cosine / range_square * factor, difference / (range_m + np.sqrt(square))


def direct(plan: Factorisation, item: TileWork, rows: Any, chirp: Chirp, aperture: Aperture) -> Any:
    """Every pair by itself: exact carrier, nearest bin of 0.5 mm, one matrix product to the T samples.

    Args:
        rows: places in the tile to evaluate.

    Returns:
        The echo, shape (rows, T).
    """
    members, seen = seen_samples(item, rows)
    table, ranges, half = SampleTable(plan, members), plan.ranges, _half_count(plan)
    carrier = np.float32(-4.0 * np.pi / ranges.wavelength_m)
    bins = np.empty((len(rows), 2 * half + 1), dtype=np.complex64)
    for i, row in enumerate(item.tile.rows[rows]):
        amplitude, excess = table.echo(aperture.tx_m[row] - ranges.center_m)
        amplitude *= seen[i]
        index = np.rint(excess * np.float32(1.0 / DIRECT_BIN_M)).astype(np.int32) + half
        phase = excess * carrier
        bins[i].real = np.bincount(index, amplitude * np.cos(phase), 2 * half + 1)
        bins[i].imag = np.bincount(index, amplitude * np.sin(phase), 2 * half + 1)
    return _samples_from_bins(bins, plan, item.tile.rows[rows], chirp, aperture)


def plain(plan: Factorisation, item: TileWork, rows: Any, chirp: Chirp, aperture: Aperture) -> Any:
    """`direct` in double precision, line by line as the formula reads."""
    members, seen = seen_samples(item, rows)
    points_m, normals = plan.samples.points_m[members], plan.samples.normals[members]
    areas_m2, taper = plan.samples.areas_m2[members], plan.taper[members]
    half, wavenumber = _half_count(plan), 2.0 * np.pi / plan.ranges.wavelength_m
    bins = np.empty((len(rows), 2 * half + 1), dtype=np.complex128)
    for i, row in enumerate(item.tile.rows[rows]):
        offsets = aperture.tx_m[row] - points_m
        range_m = np.linalg.norm(offsets, axis=1)
        cosine = np.maximum(0.0, (offsets * normals).sum(axis=1) / range_m)
        amplitude = seen[i] * areas_m2 * cosine / range_m**2 * (1.0 - taper * (1.0 - cosine**2)) ** 4
        excess = range_m - np.linalg.norm(aperture.tx_m[row] - plan.ranges.center_m)
        value = amplitude * np.exp(-2j * wavenumber * excess)
        index = np.rint(excess / DIRECT_BIN_M).astype(np.int64) + half
        bins[i] = np.bincount(index, value.real, 2 * half + 1) + 1j * np.bincount(
            index, value.imag, 2 * half + 1
        )
    return _samples_from_bins(bins, plan, item.tile.rows[rows], chirp, aperture)


def factorised(plan: Factorisation, item: TileWork, chirp: Chirp, aperture: Aperture) -> Any:
    """The stages of the compiled kernel for one tile, shape (n, T)."""
    tile, ranges = item.tile, plan.ranges
    antennas = aperture.tx_m[tile.rows] - ranges.center_m
    moments = _moments_at_nodes(plan, item)
    if tile.weights is not None:
        moments = np.tensordot(tile.weights, moments, axes=(1, 1)).transpose(1, 0, 2)
    bins = np.zeros((len(tile.rows), ranges.count, NUM_MOMENTS), dtype=np.complex64)
    centers = plan.cells.centers_m[item.cells] - ranges.center_m
    _deposit(bins, plan, _excess(antennas, centers), moments)
    partial = item.visibility.partial
    if len(partial):
        table = SampleTable(plan, partial)
        echoes = [table.echo(antenna) for antenna in antennas]
        amplitude = np.stack([echo[0] for echo in echoes])
        amplitude *= tile.ray_weights @ item.visibility.partial_visible
        _deposit(bins, plan, np.stack([echo[1] for echo in echoes]), amplitude[None])
    spectrum = bins.reshape(len(bins), -1) @ ranges.to_samples
    return spectrum * reference_phase(chirp, aperture, tile.rows, ranges.center_m)


def seen_samples(item: TileWork, rows: Any) -> tuple[Any, Any]:
    """Samples that a tile sees, and how far each of some of its antennas does."""
    members = np.concatenate([item.members, item.visibility.partial])
    seen = np.ones((len(rows), len(members)), dtype=np.float32)
    seen[:, len(item.members) :] = item.tile.ray_weights[rows] @ item.visibility.partial_visible
    return members, seen


def _half_count(plan: Factorisation) -> int:
    return int(np.ceil(0.5 * plan.ranges.count * plan.ranges.width_m / DIRECT_BIN_M))


def _samples_from_bins(bins: Any, plan: Factorisation, rows: Any, chirp: Chirp, aperture: Aperture) -> Any:
    """Bins of 0.5 mm to the T samples."""
    wavenumbers = 4.0 * np.pi * (chirp.frequencies_hz - chirp.center_hz) / SPEED_OF_LIGHT_M_PER_S
    bin_range_m = (np.arange(bins.shape[1]) - bins.shape[1] // 2) * DIRECT_BIN_M
    to_samples = np.exp(-1j * bin_range_m[:, None] * wavenumbers).astype(bins.dtype)
    return (bins @ to_samples) * reference_phase(chirp, aperture, rows, plan.ranges.center_m)


def _moments_at_nodes(plan: Factorisation, item: TileWork) -> Any:
    """Stage 1: real and imaginary moments by turns, shape (2 * NUM_MOMENTS, nodes, cells)."""
    counts = item.last - item.first
    members = np.concatenate([item.members[a:b] for a, b in zip(item.first, item.last, strict=True)])
    starts = np.cumsum(counts) - counts
    table, ranges = SampleTable(plan, members), plan.ranges
    centers = plan.cells.centers_m[item.cells] - ranges.center_m
    nodes = item.tile.node_tx_m - ranges.center_m
    to_centers = _excess(nodes, centers)
    carrier, scale = np.float32(-4.0 * np.pi / ranges.wavelength_m), np.float32(1.0 / ranges.moment_scale_m)
    moments = np.empty((2 * NUM_MOMENTS, len(nodes), len(centers)), dtype=np.float32)
    for node, antenna in enumerate(nodes):
        amplitude, excess = table.echo(antenna)
        excess -= np.repeat(to_centers[node], counts)
        phase = excess * carrier
        real, imaginary = amplitude * np.cos(phase), amplitude * np.sin(phase)
        excess *= scale
        for moment in range(NUM_MOMENTS):
            np.add.reduceat(real, starts, out=moments[2 * moment, node])
            np.add.reduceat(imaginary, starts, out=moments[2 * moment + 1, node])
            real *= excess
            imaginary *= excess
    return moments


def _deposit(bins: Any, plan: Factorisation, excess: Any, moments: Any) -> None:
    """Stage 3: carrier, moments about the bin's centre, sums. One real row = amplitudes without moments."""
    ranges = plan.ranges
    nearest = np.rint(excess * np.float32(1.0 / ranges.width_m))
    offset = (excess - nearest * np.float32(ranges.width_m)) * np.float32(1.0 / ranges.moment_scale_m)
    index = nearest.astype(np.int32) + (ranges.count // 2 + np.arange(len(bins)) * ranges.count)[:, None]
    phase = excess * np.float32(-4.0 * np.pi / ranges.wavelength_m)
    cosine, sine = np.cos(phase), np.sin(phase)
    if len(moments) == 1:
        parts = ([moments[0] * cosine], [moments[0] * sine])
        for part in parts:
            part += [part[0] * offset, part[0] * offset**2, part[0] * offset * offset**2]
    else:
        real, imaginary = moments[0::2], moments[1::2]
        parts = (
            _shifted(real * cosine - imaginary * sine, offset),
            _shifted(real * sine + imaginary * cosine, offset),
        )
    index = index.ravel()
    for part, target in zip(parts, (bins.real, bins.imag), strict=True):
        for moment, value in enumerate(part):
            sums = np.bincount(index, value.ravel(), bins.shape[0] * bins.shape[1])
            target[..., moment] += sums.reshape(bins.shape[:2])


def _shifted(moments: Any, offset: Any) -> list[Any]:
    m0, m1, m2, m3 = moments
    first = m1 + offset * m0
    third = m3 + offset * (3.0 * m2 + offset * (3.0 * m1 + offset * m0))
    return [m0, first, m2 + offset * (m1 + first), third]


def _excess(antennas: Any, points: Any) -> Any:
    """Range to points minus range to the origin, shape (n, points), float32."""
    antennas, points = antennas.astype(np.float32), points.astype(np.float32)
    square = (antennas**2).sum(axis=1)[:, None]
    difference = (points**2).sum(axis=1) - 2.0 * (antennas @ points.T)
    return difference / (np.sqrt(square + difference) + np.sqrt(square))
