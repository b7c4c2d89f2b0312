"""The two kernels of `focus`: range bins to cells at antennas, and cells at nodes to columns of voxels."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array2f, Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device
from waveformer.simulator.echo_terms import phasor
from waveformer.simulator.kernel_factorised import Antennas, antenna_lanes, bin_of
from waveformer.simulator.range_bins import RangeBins

# Moments in range that a cell keeps: with cells of 3 wavelengths and 4 GHz the third order is below 1 %.
FOCUS_MOMENTS = 3


class Columns(NamedTuple):
    """Columns of voxels along z, one a lane; all have equally many voxels.

    Attributes:
        cell: cell of every column.
        centers: centre of that cell.
        x, y: offset of the column from it.
        z: offsets of its voxels, one array a voxel.
    """

    cell: UInt32
    centers: Array3f
    x: Float
    y: Float
    z: list[Float]


def collect_moments(
    bins: NDArray[np.complex64], ranges: RangeBins, antennas: Antennas, centers: Float
) -> list[Float]:
    """Moments of every cell's neighbourhood at every antenna, launched and not waited for.

    Args:
        bins: adjoint of the bins of the antennas, shape (n, count * FOCUS_MOMENTS).
        ranges: the bins.
        antennas: n antennas, relative to the reference point of the bins.
        centers: 3 floats a cell, relative to it, Q cells.

    Returns:
        2 * FOCUS_MOMENTS arrays (n * Q,), antenna by antenna: real and imaginary parts.
    """
    padded = np.zeros((len(bins) * ranges.count, 4), dtype=np.complex64)
    padded[:, :FOCUS_MOMENTS] = bins.reshape(-1, FOCUS_MOMENTS)
    table = to_device(padded.view(np.float32))
    _, row, cell = antenna_lanes(antennas.count, dr.width(centers) // 3)
    excess = antennas.excess_m(row, dr.gather(Array3f, centers, cell))
    bin_index, offset = bin_of(excess, ranges)
    lane = 2 * (row * dr.opaque(UInt32, ranges.count) + bin_index)
    head, tail = dr.gather(Array4f, table, lane), dr.gather(Array4f, table, lane + 1)
    cosine, sine = phasor(excess * dr.opaque(Float, 2.0 / ranges.wavelength_m))
    shifted = [
        [m0 + offset * (m1 + offset * m2), m1 + 2.0 * offset * m2, m2]
        for m0, m1, m2 in ((head.x, head.z, tail.x), (head.y, head.w, tail.y))
    ]
    values: list[Float] = []
    for a, b in zip(*shifted, strict=True):
        values += [a * cosine - b * sine, a * sine + b * cosine]
    dr.eval(values)
    return values


def add_columns(
    sums: list[Float],
    columns: Columns,
    nodes: list[NDArray[np.float64]],
    moments: NDArray[np.float32],
    ranges: RangeBins,
    axes: tuple[int, ...],
) -> list[Float]:
    """Add one tile's part of the image, and of the sum of contributions times antenna position.

    The range difference of a voxel to its cell's centre is expanded to third order in offset over distance.

    Args:
        sums: so far: for every voxel of a column real and imaginary part of S, then of the sum of s p along every
            axis asked for.
        columns: the voxels.
        nodes: M transmitter positions, and receiver positions unless they coincide, shapes (M, 3).
        moments: of every cell at every node, shape (Q, M, 2 * FOCUS_MOMENTS).
        ranges: the carrier's wavelength and the scale of the moments.
        axes: components of the antenna positions to sum with.

    Returns:
        The new sums, launched and not waited for.
    """
    count = moments.shape[1]
    low, high = to_device(moments[:, :, :4]), to_device(moments[:, :, 4:])
    sides = [to_device(np.pad(side, ((0, 0), (0, 1)))) for side in nodes]
    num_nodes = dr.opaque(UInt32, count)
    turns = dr.opaque(Float, 2.0 / ranges.wavelength_m)
    inverse_scale = dr.opaque(Float, 1.0 / ranges.moment_scale_m)
    across = columns.x * columns.x + columns.y * columns.y
    squares = [across + z * z for z in columns.z]

    def body(node: UInt32, *before: Float) -> tuple[Any, ...]:
        lane = columns.cell * num_nodes + node
        a, b = dr.gather(Array4f, low, lane), dr.gather(Array2f, high, lane)
        positions = [dr.gather(Array4f, side, node) for side in sides]
        ways = [_towards(columns, position) for position in positions]
        place = positions[0] if len(positions) == 1 else 0.5 * (positions[0] + positions[1])
        after: list[Any] = [node + 1]
        for voxel, (z, square) in enumerate(zip(columns.z, squares, strict=True)):
            excess = _excess(ways, z, square)
            x = excess * inverse_scale
            p, q = a.x + x * (a.z + x * b.x), a.y + x * (a.w + x * b.y)
            cosine, sine = phasor(excess * turns)
            part = p * cosine - q * sine, p * sine + q * cosine
            factors = [1.0, *(place[axis] for axis in axes)]
            done = 2 * voxel * len(factors)
            for factor in factors:
                after += [before[done] + part[0] * factor, before[done + 1] + part[1] * factor]
                done += 2
        return tuple(after)

    start = dr.zeros(UInt32, dr.width(columns.cell))
    result = dr.while_loop(
        state=(start, *sums), cond=lambda node, *_: node < num_nodes, body=body, label="focus_columns"
    )
    dr.eval(result)
    return list(result[1:])


def _towards(columns: Columns, position: Any) -> tuple[Any, Any, Any]:
    """Component across and along z of the unit vector from an antenna to the cell, and half the inverse distance."""
    way = columns.centers - Array3f(position.x, position.y, position.z)
    inverse = dr.rsqrt(dr.squared_norm(way))
    return (way.x * columns.x + way.y * columns.y) * inverse, way.z * inverse, 0.5 * inverse


def _excess(ways: list[tuple[Any, Any, Any]], z: Any, square: Any) -> Any:
    """Half of the path difference between a voxel and its cell's centre."""
    total = None
    for across, along, half_inverse in ways:
        projected = across + along * z
        bend = (square - projected * projected) * half_inverse
        excess = projected + bend * (1.0 - 2.0 * half_inverse * projected)
        total = excess if total is None else 0.5 * (total + excess)
    return total
