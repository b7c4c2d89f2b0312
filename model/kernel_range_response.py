"""Range histograms of the surfaces at many levels, in Dr.Jit.

The NumPy float64 twin is `reference_range_response.range_responses`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array2f, Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device, to_device_index
from waveformer.simulator.echo_terms import echo, leg, phasor
from waveformer.simulator.kernel_factorised import Antennas


@dataclass(frozen=True)
class HistogramBins:
    """Range bins, the same for every antenna: bin b is centred on first_m + b * width_m."""

    first_m: float
    width_m: float
    count: int


def range_histograms(
    table: NDArray[np.float64],
    starts: NDArray[np.int64],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    bins: HistogramBins,
    wavelength_m: float,
) -> NDArray[np.float32]:
    """Echo of every level over range, for every antenna.

    A lane is one (level, antenna) pair that walks the level's points. It alone writes to its histogram, so
    nothing is lost without atomic additions and the sums do not depend on the number of threads; and
    neighbouring lanes read the same point at the same time.

    Args:
        table: a row per point: offset from the reference point, normal, area, 0; shape (P, 8).
        starts: first point of every level, then P; shape (L + 1,).
        tx_m, rx_m: antennas relative to the reference point, (n, 3); rx_m None means monostatic.
        bins: must hold every range that occurs.
        wavelength_m: of the carrier; 0 sums powers instead, weight^2 / area, which do not depend on how
            finely a surface is sampled.

    Returns:
        Sums of weight * exp(-2 j k (R - R_ref)), R_ref the range of the reference point; shape
        (L, n, bins, 2), real and imaginary part. Powers fill the real part only.
    """
    coherent = wavelength_m > 0
    num_levels, num_antennas = len(starts) - 1, len(tx_m)
    reference_m = np.linalg.norm(tx_m, axis=1)
    if rx_m is not None:
        reference_m = 0.5 * (reference_m + np.linalg.norm(rx_m, axis=1))
    offset = to_device((reference_m - bins.first_m) / bins.width_m)
    points, first = to_device(table), to_device_index(starts)
    antennas = Antennas(tx_m, rx_m)

    lane = dr.arange(UInt32, num_levels * num_antennas)
    level = lane // dr.opaque(UInt32, num_antennas)
    row = lane - level * dr.opaque(UInt32, num_antennas)
    sides = antennas.at(row)
    origin = dr.gather(Float, offset, row)
    histogram = lane * dr.opaque(UInt32, bins.count)
    per_metre = dr.opaque(Float, 1.0 / bins.width_m)
    turns = dr.opaque(Float, -2.0 / wavelength_m if coherent else 0.0)
    stop = dr.gather(UInt32, first, level + 1)
    sums = dr.zeros(Float, 2 * num_levels * num_antennas * bins.count)

    def body(index: UInt32) -> tuple[Any, ...]:
        head, tail = dr.gather(Array4f, points, 2 * index), dr.gather(Array4f, points, 2 * index + 1)
        point, normal = Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y)
        legs = [leg(position, range_m, point, normal) for position, range_m in sides]
        weight, excess, _ = echo(legs[0], legs[1] if len(legs) > 1 else None, tail.z, 0.0, False)
        if coherent:
            cosine, sine = phasor(excess * turns)
            value = Array2f(weight * cosine, weight * sine)
        else:
            value = Array2f(weight * weight * dr.rcp(tail.z), 0.0)
        target = histogram + UInt32(dr.round(excess * per_metre + origin))
        dr.scatter_reduce(dr.ReduceOp.Add, sums, value, target, mode=dr.ReduceMode.NoConflicts)
        return (index + 1,)

    begin = dr.gather(UInt32, first, level)
    dr.while_loop(
        state=(UInt32(begin),), cond=lambda index: index < stop, body=body, label="range_histograms"
    )
    dr.eval(sums)
    return np.asarray(sums.numpy().reshape(num_levels, num_antennas, bins.count, 2))
