"""Point scatterers of unit amplitude and their adjoint, factorised as in `kernel_factorised`.

Every function here stands beside the one it is the conjugate transpose of:

    point_moments                     <->  points_from_moments    points and tile nodes
    kernel_factorised.deposit_cells   <->  collect_cells          cells and range bins
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device, to_device_index, to_device_vectors
from waveformer.simulator.echo_terms import phasor
from waveformer.simulator.kernel_factorised import Antennas, antenna_lanes, bin_of, range_excess
from waveformer.simulator.range_bins import NUM_MOMENTS, RangeBins


def point_moments(
    offsets: Array3f,
    real: Float,
    imaginary: Float,
    first: UInt32,
    last: UInt32,
    centers: NDArray[np.float64],
    nodes: list[NDArray[np.float64]],
    ranges: RangeBins,
) -> NDArray[np.float32]:
    """Moments sum x exp(-2 j k_c rho) (rho / X)^i of every cell at every node.

    Args:
        offsets: points relative to their cell's centre, cell by cell.
        real, imaginary: amplitudes x of the points.
        first, last: range of points of every cell.
        centers: centres of the cells (Q, 3).
        nodes: M transmitter positions, and the receiver positions unless monostatic.
        ranges: the carrier's wavelength and X, the scale of the moments.

    Returns:
        Shape (2 * NUM_MOMENTS, M, Q).
    """
    antennas = [to_device_vectors((side[:, None] - centers).reshape(-1, 3)) for side in nodes]
    lane_cell = to_device_index(np.tile(np.arange(len(centers)), len(nodes[0])))
    begin, stop = dr.gather(UInt32, first, lane_cell), dr.gather(UInt32, last, lane_cell)
    turns = dr.opaque(Float, -2.0 / ranges.wavelength_m)
    inverse_scale = dr.opaque(Float, 1.0 / ranges.moment_scale_m)

    def body(index: UInt32, *sums: Float) -> tuple[Any, ...]:
        excess = _mean_excess(antennas, dr.gather(Array3f, offsets, index))
        cosine, sine = phasor(excess * turns)
        a, b = dr.gather(Float, real, index), dr.gather(Float, imaginary, index)
        part = [a * cosine - b * sine, a * sine + b * cosine]
        updated: list[Any] = [index + 1]
        for moment in range(NUM_MOMENTS):
            updated += [sums[2 * moment] + part[0], sums[2 * moment + 1] + part[1]]
            part = [value * (excess * inverse_scale) for value in part]
        return tuple(updated)

    zeros = [dr.zeros(Float, dr.width(begin)) for _ in range(2 * NUM_MOMENTS)]
    state = dr.while_loop(
        state=(UInt32(begin), *zeros), cond=lambda index, *_: index < stop, body=body, label="point_moments"
    )
    dr.eval(state)
    moments = np.stack([value.numpy() for value in state[1:]])
    return moments.reshape(2 * NUM_MOMENTS, len(nodes[0]), len(centers))


def points_from_moments(
    real: Float,
    imaginary: Float,
    offsets: Array3f,
    cell: UInt32,
    centers: Array3f,
    moments: NDArray[np.float32],
    nodes: list[NDArray[np.float64]],
    ranges: RangeBins,
) -> tuple[Float, Float]:
    """The adjoint of `point_moments`, added to (real, imaginary): a lane is one point.

    Args:
        real, imaginary: image so far, one value a point.
        offsets: points relative to their cell's centre.
        cell: cell of every point.
        centers: centre of every point's cell.
        moments: adjoint moments of every (cell, node), shape (Q, M, 2 * NUM_MOMENTS).
        nodes, ranges: as in `point_moments`.
    """
    table = to_device(moments)
    positions = [to_device(side) for side in nodes]
    count = dr.opaque(UInt32, moments.shape[1])
    turns = dr.opaque(Float, 2.0 / ranges.wavelength_m)
    inverse_scale = dr.opaque(Float, 1.0 / ranges.moment_scale_m)

    def body(node: UInt32, a: Float, b: Float) -> tuple[Any, ...]:
        antennas = [dr.gather(Array3f, side, node) - centers for side in positions]
        excess = _mean_excess(antennas, offsets)
        lane = 2 * (cell * count + node)
        low, high = dr.gather(Array4f, table, lane), dr.gather(Array4f, table, lane + 1)
        x = excess * inverse_scale
        p = low.x + x * (low.z + x * (high.x + x * high.z))
        q = low.y + x * (low.w + x * (high.y + x * high.w))
        cosine, sine = phasor(excess * turns)
        return node + 1, a + (p * cosine - q * sine), b + (p * sine + q * cosine)

    start = dr.zeros(UInt32, dr.width(cell))
    _, real, imaginary = dr.while_loop(
        state=(start, real, imaginary),
        cond=lambda node, *_: node < count,
        body=body,
        label="points_from_moments",
    )
    dr.eval(real, imaginary)
    return real, imaginary


def collect_cells(
    bins: NDArray[np.complex64], ranges: RangeBins, antennas: Antennas, cells: UInt32, centers: Float
) -> NDArray[np.float32]:
    """The adjoint of `kernel_factorised.deposit_cells`.

    Args:
        bins: adjoint of the bins, shape (n, count * NUM_MOMENTS).
        ranges, antennas, cells, centers: as in `deposit_cells`, Q cells.

    Returns:
        Moments of every antenna and cell, shape (2 * NUM_MOMENTS, n, Q).
    """
    num_cells = dr.width(cells)
    _, row, column = antenna_lanes(antennas.count, num_cells)
    excess = antennas.excess_m(row, dr.gather(Array3f, centers, dr.gather(UInt32, cells, column)))
    bin_index, offset = bin_of(excess, ranges)
    table = to_device(np.ascontiguousarray(bins).view(np.float32))
    lane = 2 * (row * dr.opaque(UInt32, ranges.count) + bin_index)
    packed = [*dr.gather(Array4f, table, lane), *dr.gather(Array4f, table, lane + 1)]
    cosine, sine = phasor(excess * dr.opaque(Float, 2.0 / ranges.wavelength_m))
    values: list[Any] = []
    shifted = [_shifted_adjoint(packed[part::2], offset) for part in range(2)]
    for a, b in zip(*shifted, strict=True):
        values += [a * cosine - b * sine, a * sine + b * cosine]
    dr.eval(values)
    return np.stack([value.numpy() for value in values]).reshape(2 * NUM_MOMENTS, antennas.count, num_cells)


def _mean_excess(antennas: list[Array3f], point: Array3f) -> Any:
    """Half of the path difference between a point and its cell's centre."""
    total = None
    for antenna in antennas:
        square = dr.squared_norm(antenna)
        excess = range_excess(dr.squared_norm(point) - 2.0 * dr.dot(antenna, point), square, dr.sqrt(square))
        total = excess if total is None else 0.5 * (total + excess)
    return total


def _shifted_adjoint(moments: list[Any], offset: Any) -> list[Any]:
    """Transpose of the binomial shift in `kernel_factorised`: sum_i C(i, j) offset^(i-j) m_i."""
    m0, m1, m2, m3 = moments
    return [
        m0 + offset * (m1 + offset * (m2 + offset * m3)),
        m1 + offset * (2.0 * m2 + 3.0 * offset * m3),
        m2 + 3.0 * offset * m3,
        m3,
    ]
