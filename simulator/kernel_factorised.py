"""The fast kernel: the surface sum factorised between cells of samples and tiles of antennas.

Over a tile of antennas the echo of a compact cell, freed of the carrier to the cell's centre, is a
smooth function of the antenna's position. So it is evaluated at a few Chebyshev nodes of the tile
only (stage 1), interpolated to the antennas (stage 2, a matrix product), given the exact carrier
phase back and dropped into coarse range bins (stage 3), and turned into the T samples (stage 4, a
matrix product). What varies over the band inside a cell and a bin is carried by four moments in
range, so neither the bin width nor the cell size shows in the result: for smooth cells every step has
the error bound of `interpolation.points_for_phase`. Where a surface turns away inside a tile the cosine has
a kink (monostatic) or a step (pairs, one antenna sets first) that the nodes smooth over: a sphere of 2 cm
loses 1e-3 and 3e-3 by it, whatever the tolerance.

The NumPy float64 twin is `reference_factorised.factorised_echo`.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device
from waveformer.simulator.echo_terms import echo, leg, phasor
from waveformer.simulator.range_bins import NUM_MOMENTS, RangeBins
from waveformer.simulator.response import Response


class NodeLanes(NamedTuple):
    """The (node, cell) pairs of a batch of tiles, one a lane.

    Attributes:
        node, cell: which node and which cell a lane is.
        transmitters, receivers: table of 3 floats a node; receivers None means monostatic.
        centers: table of 3 floats a cell.
        first, last: range of lit samples of every cell.
        frequency: entry of the response's frequencies of every lane.
        shares: visibility, 0 .. 1, for every node and member; None means 1.
        share_begins: `shares` of a lane lie at this plus the index into `members`.
    """

    node: UInt32
    cell: UInt32
    transmitters: Float
    receivers: Float | None
    centers: Float
    first: UInt32
    last: UInt32
    frequency: UInt32
    shares: Float | None = None
    share_begins: UInt32 | None = None


def cell_moments(
    samples: Float,
    members: UInt32,
    lanes: NodeLanes,
    ranges: RangeBins,
    two_sided: bool,
    response: Response | None,
) -> list[Float]:
    """Stage 1: moments of every cell's echo at every node position, not yet evaluated.

    A lane is one (node, cell) pair and loops over the lit samples of the cell.

    Args:
        samples: table of 8 floats a sample: offset from the cell centre, normal, area, taper.
        members: sample indices, the lit ones of every cell together.
        lanes: the pairs.
        ranges: the carrier's wavelength and X, the scale of the moments.
        two_sided: see `echo_terms.echo`.
        response: factor W of a pair; None for 1.

    Returns:
        Real and imaginary parts of the moments sum W g exp(-2 j k_c rho) (rho / X)^i: 2 * NUM_MOMENTS
        arrays (lanes,).
    """
    center = dr.gather(Array3f, lanes.centers, lanes.cell)
    transmit = dr.gather(Array3f, lanes.transmitters, lanes.node) - center
    transmit_range = dr.norm(transmit)
    receive = None if lanes.receivers is None else dr.gather(Array3f, lanes.receivers, lanes.node) - center
    receive_range = None if receive is None else dr.norm(receive)
    first, last = dr.gather(UInt32, lanes.first, lanes.cell), dr.gather(UInt32, lanes.last, lanes.cell)
    path = None
    if response is not None:
        antennas = [transmit] if receive is None else [transmit, receive]
        path = response.path_of_cells(center, [antenna + center for antenna in antennas], lanes.frequency)
    turns_per_metre = dr.opaque(Float, -2.0 / ranges.wavelength_m)
    inverse_scale = dr.opaque(Float, 1.0 / ranges.moment_scale_m)

    def body(index: UInt32, *sums: Float) -> tuple[Any, ...]:
        member = dr.gather(UInt32, members, index)
        head = dr.gather(Array4f, samples, 2 * member)
        tail = dr.gather(Array4f, samples, 2 * member + 1)
        point, normal = Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y)
        back = None if receive is None else leg(receive, receive_range, point, normal)
        out = leg(transmit, transmit_range, point, normal)
        amplitude, excess, cosine = echo(out, back, tail.z, tail.w, two_sided)
        if lanes.shares is not None:
            amplitude = amplitude * dr.gather(Float, lanes.shares, lanes.share_begins + index)
        turns = excess * turns_per_metre
        if path is not None:
            turns = turns + dr.dot(path.gradient_imaginary, point) * (0.5 / np.pi)
            growth = dr.dot(path.gradient_real, point)
            amplitude = amplitude * (1.0 + growth + 0.5 * growth * growth)
        real, imaginary = phasor(turns)
        real, imaginary = real * amplitude, imaginary * amplitude
        if response is not None:
            legs = [out] if back is None else [out, back]
            real, imaginary = _times(real, imaginary, response.surface(legs, cosine, normal, lanes.frequency))
        power = excess * inverse_scale
        updated: list[Any] = [index + 1]
        for moment in range(NUM_MOMENTS):
            updated += [sums[2 * moment] + real, sums[2 * moment + 1] + imaginary]
            real, imaginary = real * power, imaginary * power
        return tuple(updated)

    zeros = [dr.zeros(Float, dr.width(first)) for _ in range(2 * NUM_MOMENTS)]
    state = dr.while_loop(
        state=(UInt32(first), *zeros), cond=lambda index, *_: index < last, body=body, label="cell_moments"
    )
    sums = list(state[1:])
    if path is not None:
        for i in range(NUM_MOMENTS):
            sums[2 * i : 2 * i + 2] = _times(sums[2 * i], sums[2 * i + 1], path.value)
    return sums


class Antennas:
    """Device tables of the antennas of one tile, relative to a reference point.

    Args:
        transmitters, receivers: positions minus reference point (n, 3); receivers None means monostatic.
    """

    def __init__(self, transmitters: NDArray[np.float64], receivers: NDArray[np.float64] | None) -> None:
        self.count = len(transmitters)
        self._sides = [_side(side) for side in (transmitters, receivers) if side is not None]

    def along(self, seed: Float, motions: Sequence[NDArray[np.float64] | None]) -> Antennas:
        """The same antennas, moving with the seed: velocity (3,) of the transmitters, then of the receivers."""
        moving = copy(self)
        moving._sides = [
            side if motion is None else _moving(side, seed, motion)
            for side, motion in zip(self._sides, motions, strict=False)
        ]
        return moving

    def at(self, row: UInt32) -> list[tuple[Any, Any]]:
        """(position, range) of every side for the antenna of each lane."""
        return [(dr.gather(Array3f, p, row), dr.gather(Float, r, row)) for p, r in self._sides]

    def excess_m(self, row: UInt32, point: Any) -> Any:
        """Half of the path difference between `point` and the reference point."""
        total = None
        for position, range_m in self.at(row):
            difference = dr.squared_norm(point) - 2.0 * dr.dot(position, point)
            excess = range_excess(difference, range_m * range_m, range_m)
            total = excess if total is None else 0.5 * (total + excess)
        return total


def _side(positions: NDArray[np.float64]) -> tuple[Float, Float]:
    return to_device(positions), to_device(np.linalg.norm(positions, axis=1))


def _moving(side: tuple[Float, Float], seed: Float, motion: NDArray[np.float64]) -> tuple[Float, Float]:
    positions, ranges = side
    vectors = dr.gather(Array3f, positions, dr.arange(UInt32, dr.width(ranges)))
    closing = dr.dot(vectors, Array3f(*(float(value) for value in motion))) * dr.rcp(ranges)
    return positions + seed * to_device(np.tile(motion, dr.width(ranges))), ranges + seed * closing


def deposit_cells(
    bins: Float,
    ranges: RangeBins,
    moments: list[Float],
    antennas: Antennas,
    cells: UInt32,
    centers: Float,
) -> None:
    """Stage 3: give every cell its carrier to every antenna and add it to that antenna's range bins.

    A lane is one (antenna, cell) pair; its moments are shifted from the cell's centre to the bin's.
    The adjoint is `kernel_points.collect_cells`.

    Args:
        bins: (antennas * num_bins * 2 * NUM_MOMENTS) accumulators.
        ranges: the range bins.
        moments: interpolated moments, antenna-major, 2 * NUM_MOMENTS arrays (antennas * cells,).
        antennas: relative to the reference point of `ranges`.
        cells: rows of `centers` that `moments` holds.
        centers: table of 3 floats a cell, relative to the same point.
    """
    lane, row, column = antenna_lanes(antennas.count, dr.width(cells))
    excess = antennas.excess_m(row, dr.gather(Array3f, centers, dr.gather(UInt32, cells, column)))
    bin_index, offset = bin_of(excess, ranges)
    real, imaginary = phasor(excess * dr.opaque(Float, -2.0 / ranges.wavelength_m))
    packed = [dr.gather(Float, moment, lane) for moment in moments]
    rotated = [
        (
            packed[2 * i] * real - packed[2 * i + 1] * imaginary,
            packed[2 * i] * imaginary + packed[2 * i + 1] * real,
        )
        for i in range(NUM_MOMENTS)
    ]
    shifted = [_shifted([value[part] for value in rotated], offset) for part in range(2)]
    complex_moments = list(zip(*shifted, strict=True))
    index = row * dr.opaque(UInt32, ranges.count) + bin_index
    for half in range(2):  # Dr.Jit scatters packets of four floats
        packet = Array4f(*complex_moments[2 * half], *complex_moments[2 * half + 1])
        dr.scatter_reduce(dr.ReduceOp.Add, bins, packet, 2 * index + half)


def deposit_samples(
    bins: Float,
    ranges: RangeBins,
    samples: Float,
    members: UInt32,
    antennas: Antennas,
    visible: Float,
    two_sided: bool,
    num_moments: int,
    response: Response | None,
    frequency: int,
) -> None:
    """The few samples whose visibility changes inside a tile: pair by pair into the same bins.

    Args:
        bins, ranges, antennas: as in `deposit_cells`.
        samples: table of 8 floats a sample, offset from the reference point.
        members: rows of `samples` to sum.
        visible: 0 .. 1 for every (antenna, member).
        two_sided: see `echo_terms.echo`.
        num_moments: 2 or 4; a lone sample lies within half a bin of its bin, where two may do.
        response, frequency: factor W of a pair and the entry of its frequencies; None for 1.
    """
    lane, row, column = antenna_lanes(antennas.count, dr.width(members))
    seen = dr.gather(Float, visible, lane)
    member = dr.gather(UInt32, members, column)
    head, tail = dr.gather(Array4f, samples, 2 * member), dr.gather(Array4f, samples, 2 * member + 1)
    point, normal = Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y)
    legs = [leg(position, range_m, point, normal) for position, range_m in antennas.at(row)]
    amplitude, excess, cosine = echo(legs[0], legs[1] if len(legs) > 1 else None, tail.z, tail.w, two_sided)
    amplitude = amplitude * seen
    bin_index, offset = bin_of(excess, ranges)
    real, imaginary = phasor(excess * dr.opaque(Float, -2.0 / ranges.wavelength_m))
    real, imaginary = real * amplitude, imaginary * amplitude
    if response is not None:
        reference = Array3f(*(dr.opaque(Float, float(value)) for value in ranges.center_m))
        entry = dr.opaque(UInt32, frequency)
        real, imaginary = _times(real, imaginary, response.surface(legs, cosine, normal, entry))
        real, imaginary = _times(real, imaginary, response.path(reference + point, legs, entry))
    index = row * dr.opaque(UInt32, ranges.count) + bin_index
    for half in range(num_moments // 2):
        packet = Array4f(real, imaginary, real * offset, imaginary * offset)
        dr.scatter_reduce(dr.ReduceOp.Add, bins, packet, 2 * index + half, amplitude != 0)
        real, imaginary = real * offset * offset, imaginary * offset * offset


def _times(real: Any, imaginary: Any, factor: Any) -> tuple[Any, Any]:
    """Real and imaginary part of a product."""
    return real * factor.real - imaginary * factor.imag, real * factor.imag + imaginary * factor.real


def range_excess(difference: Any, square: Any, range_m: Any) -> Any:
    """sqrt(square + difference) - range without cancellation; an antenna may lie on the point itself."""
    other = square + difference
    total = dr.sqrt(dr.select(other > 0, other, 0.0)) + range_m
    return dr.select(total > 0, difference * dr.rcp(total), 0.0)


def antenna_lanes(num_antennas: int, num_columns: int) -> tuple[UInt32, UInt32, UInt32]:
    """Lane, antenna row and column of every (antenna, column) pair, antenna-major."""
    lane = dr.arange(UInt32, num_antennas * num_columns)
    row = lane // dr.opaque(UInt32, num_columns)
    return lane, row, lane - row * dr.opaque(UInt32, num_columns)


def bin_of(excess_m: Any, ranges: RangeBins) -> tuple[Any, Any]:
    """Nearest bin and the signed distance from its centre in units of the moment scale."""
    nearest = dr.round(excess_m * dr.opaque(Float, 1.0 / ranges.width_m))
    offset = (excess_m - nearest * dr.opaque(Float, ranges.width_m)) * dr.opaque(
        Float, 1.0 / ranges.moment_scale_m
    )
    return UInt32(nearest + dr.opaque(Float, ranges.count // 2)), offset


def _shifted(moments: list[Any], offset: Any) -> list[Any]:
    """Moments about a point at distance -offset: sum_j C(i, j) offset^(i-j) m_j."""
    m0, m1, m2, m3 = moments
    first = m1 + offset * m0
    return [
        m0,
        first,
        m2 + offset * (m1 + first),
        m3 + offset * (3.0 * m2 + offset * (3.0 * m1 + offset * m0)),
    ]
