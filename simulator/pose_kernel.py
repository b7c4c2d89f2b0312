"""The echo of one surface in many poses, at a few frequencies, with its derivatives by the pose, in Dr.Jit.

Made for a search: visibility from one point, no tiles, no bins. Antennas are moved into the frame of the object, so
that all poses share one table of samples. One pass over the pairs gives the signal and six columns; the sums of all
frequencies stay in registers. Its twin in NumPy is `reference.dense_echo`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Array4f, Float, UInt32
from waveformer.simulator.device import to_device, to_device_index, to_device_vectors
from waveformer.simulator.echo_terms import echo, leg, phasor
from waveformer.simulator.pose_body import BodySamples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp
from waveformer.simulator.rigid_pose import RigidPose

# Enough lanes to fill the vector units of a CPU or the cores of a GPU.
_LANES = 1 << 14


def pose_echoes(
    samples: BodySamples, poses: Sequence[RigidPose], tx_m: NDArray[np.float64], nodes: Chirp
) -> NDArray[np.complex64]:
    """Signal of a perfect conductor in several poses.

    Args:
        samples: what is lit, whatever the pose.
        poses: P.
        tx_m: monostatic antennas (N, 3).
        nodes: M frequencies.

    Returns:
        Shape (P, N, M), calibrated as H.
    """
    return _sum(samples, poses, tx_m, nodes, columns=False)[..., 0]


def pose_derivatives(
    samples: BodySamples, pose: RigidPose, tx_m: NDArray[np.float64], nodes: Chirp
) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
    """Signal and its derivatives by the arguments of `RigidPose.moved`; arguments as in `pose_echoes`.

    Only the phase is differentiated: amplitudes change by the wavelength over the range, which is a thousandth.

    Returns:
        Shapes (N, M) and (N, M, 6), the latter per metre and per radian.
    """
    sums = _sum(samples, [pose], tx_m, nodes, columns=True)[0]
    wavenumbers = 4.0 * np.pi * nodes.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    # the sums are weighted by directions from sample to antenna: range shrinks along them
    shifts = sums[..., 1:4] @ pose.rotation.T
    turns = sums[..., 4:7] @ pose.rotation.T
    columns = 1j * wavenumbers[:, None] * np.concatenate([shifts, turns], axis=-1)
    return sums[..., 0], columns.astype(np.complex64)


def _sum(
    samples: BodySamples, poses: Sequence[RigidPose], tx_m: NDArray[np.float64], nodes: Chirp, columns: bool
) -> NDArray[np.complex64]:
    """Sums over the samples, (P, N, M, 1), or with the integrand times direction and moment (P, N, M, 7)."""
    antennas = np.concatenate([(tx_m - pose.center_m) @ pose.rotation for pose in poses])
    ranges = np.linalg.norm(antennas, axis=1)
    count, num_rows = len(samples.points_m), len(antennas)
    table = to_device(
        np.concatenate(
            [samples.points_m, samples.normals, samples.areas_m2[:, None], samples.taper[:, None]], axis=1
        )
    )
    slots = min(count, -(-_LANES // num_rows))
    first = to_device_index(np.tile(np.arange(slots), num_rows))
    antenna = to_device_vectors(np.repeat(antennas, slots, axis=0))
    range_m = to_device(np.repeat(ranges, slots))
    stop, stride = dr.opaque(UInt32, count), dr.opaque(UInt32, slots)
    spacing_hz = nodes.bandwidth_hz / nodes.num_samples
    turns, turns_between = (
        dr.opaque(Float, -2.0 * f / SPEED_OF_LIGHT_M_PER_S) for f in (nodes.start_hz, spacing_hz)
    )

    def body(index: UInt32, *sums: Float) -> tuple[Any, ...]:
        head, tail = dr.gather(Array4f, table, 2 * index), dr.gather(Array4f, table, 2 * index + 1)
        point, normal = Array3f(head.x, head.y, head.z), Array3f(head.w, tail.x, tail.y)
        way = leg(antenna, range_m, point, normal)
        amplitude, excess, _ = echo(way, None, tail.z, tail.w, False)
        real, imaginary = (amplitude * part for part in phasor(excess * turns))
        turn_real, turn_imaginary = phasor(excess * turns_between)
        factors = [*way.direction, *dr.cross(point, way.direction)] if columns else []
        updated: list[Any] = [index + stride]
        old = iter(sums)
        for node in range(nodes.num_samples):
            if node > 0:
                real, imaginary = (
                    real * turn_real - imaginary * turn_imaginary,
                    real * turn_imaginary + imaginary * turn_real,
                )
            updated += [next(old) + real, next(old) + imaginary]
            for factor in factors:
                updated += [dr.fma(factor, real, next(old)), dr.fma(factor, imaginary, next(old))]
        return tuple(updated)

    parts = 7 if columns else 1
    zeros = [dr.zeros(Float, num_rows * slots) for _ in range(2 * parts * nodes.num_samples)]
    state = dr.while_loop(
        state=(UInt32(first), *zeros), cond=lambda index, *_: index < stop, body=body, label="pose_sums"
    )
    dr.eval(state)  # all sums in one launch
    sums = np.stack([value.numpy().reshape(num_rows, slots).sum(axis=1) for value in state[1:]], axis=1)
    sums = sums.reshape(num_rows, nodes.num_samples, parts, 2)
    wavenumbers = 4.0 * np.pi * nodes.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    # j / (4 pi) times Gamma = -1 of a conductor, and the phase of the way to the middle
    scale = -1j / (4.0 * np.pi) * np.exp(-1j * ranges[:, None] * wavenumbers)
    complete = (sums[..., 0] + 1j * sums[..., 1]) * scale[:, :, None]
    shape = (len(poses), len(tx_m), nodes.num_samples, parts)
    return np.asarray(complete.astype(np.complex64)).reshape(shape)
