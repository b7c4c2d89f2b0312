"""Direct sums over every pair of sample and antenna, in Dr.Jit: no tiles, no bins."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device, to_device_index, to_device_vectors
from waveformer.simulator.echo_terms import Leg, leg, phasor
from waveformer.simulator.interpolation import chebyshev_points, lagrange_weights, points_for_phase
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

# A lane sums every _SLOTS-th sample of one antenna, so that a few antennas fill the vector units.
_SLOTS = 512
_FREQUENCIES_PER_LAUNCH = 8
# The factor of a frequency is long code: fewer at a time compile faster than they lose.
_WEIGHTED_PER_LAUNCH = 2

# (ways, point, normal, area, taper) -> (amplitude, half of the path difference, complex factor of a frequency's entry)
Weight = Callable[[UInt32], Any]
Integrand = Callable[[list[Leg], Any, Any, Any, Any], tuple[Any, Any, Weight | None]]


def frequency_nodes(
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


def sum_pairs(
    table: NDArray[np.float64],
    visible: NDArray[np.bool_],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    frequencies_hz: NDArray[np.float64],
    integrand: Integrand,
    *,
    weighted: bool = False,
) -> NDArray[np.complex128]:
    """sum_s V W(f) g exp(-j 4 pi f rho / c) for every antenna and frequency.

    Args:
        table: per sample offset from the reference point, normal, weight, taper, shape (S, 8).
        visible: shape (n, S).
        tx_m, rx_m: antennas relative to the reference point, (n, 3); rx_m None means monostatic.
        frequencies_hz: shape (F,).
        integrand: amplitude g, path difference rho and factor W(f) of a pair; its point is relative, too.
        weighted: whether the integrand has such a factor.

    Returns:
        Shape (n, F).
    """
    num_samples, num_rows = len(table), len(tx_m)
    samples = to_device(table)
    mask = to_device(visible)
    slots = min(_SLOTS, num_samples)
    slot = to_device_index(np.tile(np.arange(slots), num_rows))
    row_start = to_device_index(np.repeat(np.arange(num_rows) * num_samples, slots))
    antennas = [tx_m] if rx_m is None else [tx_m, rx_m]
    positions = [to_device_vectors(np.repeat(offset, slots, axis=0)) for offset in antennas]
    ranges = [to_device(np.repeat(np.linalg.norm(offset, axis=1), slots)) for offset in antennas]
    stop, stride = dr.opaque(UInt32, num_samples), dr.opaque(UInt32, slots)

    def launch(entries: list[UInt32], turns_per_metre: list[Float]) -> list[NDArray[np.float32]]:
        def body(index: UInt32, *sums: Float) -> tuple[Any, ...]:
            head = dr.gather(Array4f, samples, 2 * index)
            tail = dr.gather(Array4f, samples, 2 * index + 1)
            seen = dr.gather(Float, mask, row_start + index)
            point, normal = Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y)
            legs = [leg(p, r, point, normal) for p, r in zip(positions, ranges, strict=True)]
            amplitude, excess, weight = integrand(legs, point, normal, tail.z, tail.w)
            amplitude *= seen
            updated: list[Any] = [index + stride]
            for i, (entry, turns) in enumerate(zip(entries, turns_per_metre, strict=True)):
                real, imaginary = phasor(excess * turns)
                if weight is not None:
                    factor = weight(entry)
                    real, imaginary = (
                        real * factor.real - imaginary * factor.imag,
                        real * factor.imag + imaginary * factor.real,
                    )
                updated += [sums[2 * i] + amplitude * real, sums[2 * i + 1] + amplitude * imaginary]
            return tuple(updated)

        zeros = [dr.zeros(Float, num_rows * slots) for _ in range(2 * len(turns_per_metre))]
        state = dr.while_loop(
            state=(UInt32(slot), *zeros), cond=lambda index, *_: index < stop, body=body, label="sum_pairs"
        )
        dr.eval(state)  # all sums in one launch
        return [value.numpy() for value in state[1:]]

    columns = []
    step = _WEIGHTED_PER_LAUNCH if weighted else _FREQUENCIES_PER_LAUNCH
    for start in range(0, len(frequencies_hz), step):
        chunk = frequencies_hz[start : start + step]
        turns = [dr.opaque(Float, float(-2.0 * f / SPEED_OF_LIGHT_M_PER_S)) for f in chunk]
        parts = launch([dr.opaque(UInt32, start + i) for i in range(len(chunk))], turns)
        columns += [
            parts[2 * i].reshape(num_rows, slots).sum(axis=1, dtype=np.float64)
            + 1j * parts[2 * i + 1].reshape(num_rows, slots).sum(axis=1, dtype=np.float64)
            for i in range(len(chunk))
        ]
    return np.stack(columns, axis=1)
