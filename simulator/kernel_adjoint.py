"""The adjoint of stage 1 of the fast kernel, written by hand: from moments at antennas to surface samples.

A sample contributes w exp(-2 j k_c rho) (rho / X)^i to the moments of its cell, w the complex amplitude and rho the
path difference of `echo_terms.echo`. For a loss L with dL = Re sum_i conj(m_i) d(moment i), q = conj(phase) sum_i m_i x^i
and x = rho / X,

    dL / dw   = q                                    (real and imaginary part for those of w)
    dL / drho = Re(conj(q) (-2 j k_c) w) + Re(conj(conj(phase) sum_i i m_i x^(i-1)) w) / X

What remains is how w and rho of one pair depend on the sample: a few dozen operations, which Dr.Jit differentiates
in registers. A lane is one sample and loops over the antennas or the nodes of a tile, so nothing is scattered and
nothing is stored per pair.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from waveformer.simulator.backend import Array3f, Array4f, Complex2f, Float, UInt32
from waveformer.simulator.echo_terms import echo, leg, phasor
from waveformer.simulator.range_bins import RangeBins
from waveformer.simulator.response import Response

# Numbers a sample has in a kernel's table: offset, normal, area, taper.
SAMPLE_FLOATS = 8
# Floats of a path factor in its table: growth of amplitude along x, y, z, then of phase, and two of padding.
PATH_FLOATS = 8


class AdjointLanes(NamedTuple):
    """The samples of one tile, one a lane, and the antennas or nodes they loop over.

    Attributes:
        member: which sample of the table a lane is.
        cell: its cell among those of the tile.
        centers: table of 3 floats a cell, in the radar frame.
        transmitters, receivers: tables of 3 floats an antenna; receivers None means monostatic.
        num_antennas: how many.
        moments: adjoint moments, 8 floats for every (cell, antenna).
        paths: `PATH_FLOATS` for every (cell, antenna) where a cell shares its path factor; its value is in the moments.
        visible: 0 .. 1 for every (antenna, lane); None for samples seen by all.
    """

    member: UInt32
    cell: UInt32
    centers: Float
    transmitters: Float
    receivers: Float | None
    num_antennas: int
    moments: Float
    paths: Float | None
    visible: Float | None


def sample_adjoint(
    samples: Float,
    lanes: AdjointLanes,
    ranges: RangeBins,
    two_sided: bool,
    response: Response | None,
    frequency: int,
) -> list[Float]:
    """DL / d(offset, normal, area, taper) of every lane's sample, launched and not waited for.

    Args:
        samples: table of `SAMPLE_FLOATS` a sample, the offset from the centre of its cell.
        lanes: what is summed.
        ranges: the carrier's wavelength and X, the scale of the moments.
        two_sided: see `echo_terms.echo`.
        response: factor W of a pair; None for 1.
        frequency: entry of the response's frequencies.

    Returns:
        `SAMPLE_FLOATS` arrays (lanes,).
    """
    head = dr.gather(Array4f, samples, 2 * lanes.member)
    tail = dr.gather(Array4f, samples, 2 * lanes.member + 1)
    center = dr.gather(Array3f, lanes.centers, lanes.cell)
    sides = [side for side in (lanes.transmitters, lanes.receivers) if side is not None]
    stop, width = dr.opaque(UInt32, lanes.num_antennas), dr.opaque(UInt32, dr.width(lanes.member))
    lane = dr.arange(UInt32, dr.width(lanes.member))
    entry = dr.opaque(UInt32, frequency)
    turns_per_metre = dr.opaque(Float, -2.0 / ranges.wavelength_m)
    wavenumber = dr.opaque(Float, 2.0 * np.pi / ranges.wavelength_m)
    inverse_scale = dr.opaque(Float, 1.0 / ranges.moment_scale_m)

    def body(antenna: UInt32, *sums: Float) -> tuple[Any, ...]:
        point, normal = Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y)
        area, taper = Float(tail.z), Float(tail.w)
        dr.enable_grad(point, normal, area, taper)
        offsets = [dr.gather(Array3f, side, antenna) - center for side in sides]
        legs = [leg(offset, dr.norm(offset), point, normal) for offset in offsets]
        amplitude, excess, cosine = echo(legs[0], legs[1] if len(legs) > 1 else None, area, taper, two_sided)
        pair = lanes.cell * stop + antenna
        weight, angle = Complex2f(amplitude, 0.0), Float(0.0)
        if response is not None:
            weight = weight * response.surface(legs, cosine, normal, entry)
            if lanes.paths is None:
                weight = weight * response.path(center + point, legs, entry)
            else:
                low, high = (dr.gather(Array4f, lanes.paths, 2 * pair + half) for half in (0, 1))
                growth = dr.dot(Array3f(low.x, low.y, low.z), point)
                weight = weight * (1.0 + growth + 0.5 * growth * growth)
                angle = dr.dot(Array3f(low.w, high.x, high.y), point)
        low, high = (dr.gather(Array4f, lanes.moments, 2 * pair + half) for half in (0, 1))
        if lanes.visible is not None:
            seen = dr.gather(Float, lanes.visible, antenna * width + lane)
            low, high = low * seen, high * seen
        by_real, by_imaginary, by_angle, by_excess = _moment_adjoint(
            dr.detach(weight),
            dr.detach(excess * turns_per_metre + angle * (0.5 / np.pi)),
            dr.detach(excess) * inverse_scale,
            (
                Complex2f(low.x, low.y),
                Complex2f(low.z, low.w),
                Complex2f(high.x, high.y),
                Complex2f(high.z, high.w),
            ),
        )
        by_path = by_excess * inverse_scale - 2.0 * wavenumber * by_angle
        dr.backward(by_real * weight.real + by_imaginary * weight.imag + by_angle * angle + by_path * excess)
        gradients = [*dr.grad(point), *dr.grad(normal), dr.grad(area), dr.grad(taper)]
        return (antenna + 1, *(total + value for total, value in zip(sums, gradients, strict=True)))

    zeros = [dr.zeros(Float, dr.width(lanes.member)) for _ in range(SAMPLE_FLOATS)]
    state = dr.while_loop(
        state=(dr.zeros(UInt32, dr.width(lanes.member)), *zeros),
        cond=lambda antenna, *_: antenna < stop,
        body=body,
        label="sample_adjoint",
    )
    sums = list(state[1:])
    dr.eval(sums)
    return sums


def _moment_adjoint(weight: Any, turns: Any, x: Any, moments: tuple[Any, ...]) -> tuple[Any, Any, Any, Any]:
    """DL by the real and imaginary part of w, by the phase of the pair in radians and by x = rho / X."""
    cosine, sine = phasor(turns)
    backwards = Complex2f(cosine, -sine)
    m0, m1, m2, m3 = moments
    q = backwards * (m0 + x * (m1 + x * (m2 + x * m3)))
    slope = backwards * (m1 + x * (2.0 * m2 + 3.0 * x * m3))
    # Re(conj(q) j w) = Im(q) Re(w) - Re(q) Im(w)
    by_phase = q.imag * weight.real - q.real * weight.imag
    return q.real, q.imag, by_phase, slope.real * weight.real + slope.imag * weight.imag
