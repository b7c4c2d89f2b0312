"""The echo of one target pair by pair: visibility traced per antenna position, no bins, no tiles.

Slower by orders of magnitude than `fast_echo` and the judge of it: the only thing they share is the
integrand (`echo_terms`) and the quadrature. Its own oracle is `reference.dense_echo` (float64).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm.ad import Array3f, Array4f, Float, UInt32
from numpy.typing import NDArray

from waveformer.simulator.device import to_device, to_device_index, to_device_vectors
from waveformer.simulator.echo_terms import echo, leg, phasor
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.interpolation import chebyshev_points, lagrange_weights, points_for_phase
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import reference_phase
from waveformer.simulator.scene import VISIBLE, sample_states

_MAX_PAIRS = 1 << 22
# A lane sums every _SLOTS-th sample of one antenna, so that a few antennas fill the vector units.
_SLOTS = 512
_FREQUENCIES_PER_LAUNCH = 8


def exact_echo(
    scene: Any,
    samples: SurfaceSamples,
    two_sided: bool,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
    tile_positions: int | None,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Sum the echo of one target, a group of antenna positions at a time.

    Arguments as in `fast_echo.fast_echo`.
    """
    wavelength = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    center = 0.5 * (samples.points_m.min(axis=0) + samples.points_m.max(axis=0))
    radius = float(np.sqrt(((samples.points_m - center) ** 2).sum(axis=1).max()))
    frequencies, to_samples = _frequency_nodes(chirp, radius, numerics.tolerance)
    rows_per_group = max(1, _MAX_PAIRS // len(samples.points_m))
    if tile_positions is not None:
        rows_per_group = min(rows_per_group, tile_positions)
    for start in range(0, len(aperture), rows_per_group):
        rows = np.arange(start, min(start + rows_per_group, len(aperture)))
        receivers = None if aperture.rx_m is None else aperture.rx_m[rows]
        states = sample_states(
            scene, samples.points_m, samples.normals, two_sided, aperture.tx_m[rows], receivers
        )
        seen = np.flatnonzero((states == VISIBLE).any(axis=0))
        if len(seen) == 0:
            continue
        at_nodes = _sum_pairs(
            take(samples, seen), taper_scale(samples, wavelength, numerics.facet_taper)[seen],
            states[:, seen] == VISIBLE, center, aperture.tx_m[rows], receivers,
            frequencies, two_sided,
        )
        add(rows, (at_nodes @ to_samples).astype(np.complex64) * reference_phase(chirp, aperture, rows, center))


def _frequency_nodes(
    chirp: Chirp, radius_m: float, tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies (F,) that determine all T samples of an object of this radius, and the matrix (F, T)."""
    half_band = 0.5 * (chirp.frequencies_hz[-1] - chirp.frequencies_hz[0])
    count = points_for_phase(4.0 * np.pi * half_band * radius_m / SPEED_OF_LIGHT_M_PER_S, tolerance)
    if count >= chirp.num_samples:
        return chirp.frequencies_hz, np.eye(chirp.num_samples)
    unit = chebyshev_points(count)
    offsets = (chirp.frequencies_hz - chirp.center_hz) / half_band
    return chirp.center_hz + half_band * unit, lagrange_weights(unit, offsets).T


def _sum_pairs(
    samples: SurfaceSamples,
    taper: NDArray[np.float64],
    visible: NDArray[np.bool_],
    center_m: NDArray[np.float64],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    frequencies_hz: NDArray[np.float64],
    two_sided: bool,
) -> NDArray[np.complex128]:
    """sum_s V g exp(-j 4 pi f rho / c) for every antenna and frequency, shape (n, F)."""
    num_samples, num_rows = len(samples.points_m), len(tx_m)
    table = to_device(
        np.concatenate(
            [samples.points_m - center_m, samples.normals, samples.areas_m2[:, None], taper[:, None]], axis=1
        )
    )
    mask = to_device(visible)
    slots = min(_SLOTS, num_samples)
    slot = to_device_index(np.tile(np.arange(slots), num_rows))
    row_start = to_device_index(np.repeat(np.arange(num_rows) * num_samples, slots))
    antennas = [tx_m - center_m] if rx_m is None else [tx_m - center_m, rx_m - center_m]
    positions = [to_device_vectors(np.repeat(offset, slots, axis=0)) for offset in antennas]
    ranges = [to_device(np.repeat(np.linalg.norm(offset, axis=1), slots)) for offset in antennas]
    stop, step = dr.opaque(UInt32, num_samples), dr.opaque(UInt32, slots)

    def launch(turns_per_metre: list[Float]) -> list[NDArray[np.float32]]:
        def body(index: UInt32, *sums: Float) -> tuple[Any, ...]:
            head = dr.gather(Array4f, table, 2 * index)
            tail = dr.gather(Array4f, table, 2 * index + 1)
            seen = dr.gather(Float, mask, row_start + index)
            point, normal = Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y)
            legs = [leg(p, r, point, normal) for p, r in zip(positions, ranges, strict=True)]
            amplitude, excess = echo(legs[0], legs[1] if len(legs) > 1 else None, tail.z, tail.w, two_sided)
            amplitude *= seen
            updated: list[Any] = [index + step]
            for i, turns in enumerate(turns_per_metre):
                real, imaginary = phasor(excess * turns)
                updated += [sums[2 * i] + amplitude * real, sums[2 * i + 1] + amplitude * imaginary]
            return tuple(updated)

        zeros = [dr.zeros(Float, num_rows * slots) for _ in range(2 * len(turns_per_metre))]
        state = dr.while_loop(
            state=(UInt32(slot), *zeros), cond=lambda index, *_: index < stop, body=body, label="sum_pairs"
        )
        dr.eval(state)  # all sums in one launch
        return [value.numpy() for value in state[1:]]

    columns = []
    for start in range(0, len(frequencies_hz), _FREQUENCIES_PER_LAUNCH):
        chunk = frequencies_hz[start : start + _FREQUENCIES_PER_LAUNCH]
        turns = [dr.opaque(Float, float(-2.0 * f / SPEED_OF_LIGHT_M_PER_S)) for f in chunk]
        parts = launch(turns)
        columns += [
            (parts[2 * i].reshape(num_rows, slots).sum(axis=1, dtype=np.float64))
            + 1j * parts[2 * i + 1].reshape(num_rows, slots).sum(axis=1, dtype=np.float64)
            for i in range(len(chunk))
        ]
    return np.stack(columns, axis=1)
