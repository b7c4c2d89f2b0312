"""Backprojection of every voxel and antenna by itself: the oracle of `focus`, and what its speed is measured against."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device
from waveformer.simulator.echo_terms import phasor


def add_antennas(
    sums: list[Float],
    voxels: Array3f,
    sides: list[NDArray[np.float64]],
    profiles: NDArray[np.complex64],
    start_m: float,
    step_m: float,
    wavelength_m: float,
) -> list[Float]:
    """Add antennas to the image, and to the sum of contributions times antenna position.

    Args:
        sums: so far: real and imaginary part of S, then of the sum of s p along x, y and z.
        voxels: relative to the origin of the antennas.
        sides: transmitters, and receivers unless they coincide, shapes (n, 3).
        profiles: range profiles freed of the carrier, shape (n, R), linear between their samples.
        start_m, step_m: range of the first sample, and from one to the next.
        wavelength_m: of the carrier.
    """
    count, num_ranges = profiles.shape
    # both neighbours of an interval in one packet
    pairs = np.stack([profiles[:, :-1], profiles[:, 1:]], axis=-1)
    table = to_device(np.ascontiguousarray(pairs).view(np.float32))
    positions = [to_device(np.pad(side, ((0, 0), (0, 1)))) for side in sides]
    num_antennas, intervals = dr.opaque(UInt32, count), dr.opaque(UInt32, num_ranges - 1)
    turns, inverse_step = dr.opaque(Float, 2.0 / wavelength_m), dr.opaque(Float, 1.0 / step_m)
    start = dr.opaque(Float, start_m)

    def body(antenna: UInt32, *before: Float) -> tuple[Any, ...]:
        places = [dr.gather(Array4f, side, antenna) for side in positions]
        ways = [dr.norm(voxels - Array3f(place.x, place.y, place.z)) for place in places]
        range_m = ways[0] if len(ways) == 1 else 0.5 * (ways[0] + ways[1])
        middle = places[0] if len(places) == 1 else 0.5 * (places[0] + places[1])
        place = (range_m - start) * inverse_step
        interval = UInt32(place)
        share = place - Float(interval)
        packet = dr.gather(Array4f, table, antenna * intervals + interval)
        real, imaginary = packet.x + share * (packet.z - packet.x), packet.y + share * (packet.w - packet.y)
        cosine, sine = phasor(range_m * turns)
        a, b = real * cosine - imaginary * sine, real * sine + imaginary * cosine
        factors = [1.0, middle.x, middle.y, middle.z][: len(before) // 2]
        after: list[Any] = [antenna + 1]
        for index, factor in enumerate(factors):
            after += [before[2 * index] + a * factor, before[2 * index + 1] + b * factor]
        return tuple(after)

    first = dr.zeros(UInt32, dr.width(sums[0]))
    result = dr.while_loop(
        state=(first, *sums),
        cond=lambda antenna, *_: antenna < num_antennas,
        body=body,
        label="direct_image",
    )
    dr.eval(result)
    return list(result[1:])
