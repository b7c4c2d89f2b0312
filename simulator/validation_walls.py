"""Truth for the echo of an empty box: dense integrals over its walls."""

from __future__ import annotations

import numpy as np

from waveformer.simulator.occluders import Box
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.slab import refraction_factor, slab_reflection, slab_transmission
from waveformer.simulator.validation_result import ComplexArray, FloatArray


def wall_echo(box: Box, antennas_m: FloatArray, frequencies_hz: FloatArray) -> ComplexArray:
    """Echo of an empty box by physical optics for antennas above its lid, E along y, monostatic.

    The lid reflects outside; the bottom and the sides reflect inside, and are seen through the lid.

    Args:
        box: of a constant permittivity.
        antennas_m: so near the axis that every way to the inside leads through the lid, shape (N, 3).
        frequencies_hz: shape (F,).

    Returns:
        h, shape (N, F).
    """
    low, high = np.asarray(box.min_m), np.asarray(box.max_m)
    inner_low, inner_high = low + box.thickness_m, high - box.thickness_m
    lid = (low * [1, 1, 0] + high * [0, 0, 1], high)
    faces = [(2, lid, False), (2, (inner_low, inner_high * [1, 1, 0] + inner_low * [0, 0, 1]), True)]
    for axis in (0, 1):
        for place in (inner_low[axis], inner_high[axis]):
            start, stop = inner_low.copy(), inner_high.copy()
            start[axis] = stop[axis] = place
            faces.append((axis, (start, stop), True))
    echoes = [
        _face_echo(box, axis, corners, antennas_m, frequencies_hz, inside=inside)
        for axis, corners, inside in faces
    ]
    return np.asarray(np.sum(echoes, axis=0))


def _face_echo(
    box: Box,
    axis: int,
    corners: tuple[FloatArray, FloatArray],
    antennas_m: FloatArray,
    frequencies_hz: FloatArray,
    *,
    inside: bool,
) -> ComplexArray:
    """One rectangle across an axis, between two corners; h, shape (N, F)."""
    middle, half = (corners[0] + corners[1]) / 2, (corners[1] - corners[0]) / 2
    first, second = (other for other in range(3) if other != axis)
    k = 2 * np.pi * frequencies_hz.max() / SPEED_OF_LIGHT_M_PER_S
    steepest = (
        np.abs(antennas_m[:, None] - np.stack(corners)).max(axis=(0, 1))
        / (antennas_m[:, 2] - corners[1][2]).min()
    )
    # Along an edge the phase turns by at most 2 k per metre times the sine; a Gauss rule takes a node for two radians
    counts = (24 + 2.2 * k * half * np.minimum(steepest, 1.0)).astype(int)
    (x, dx), (y, dy) = (np.polynomial.legendre.leggauss(counts[other]) for other in (first, second))
    points = np.tile(middle, (len(x), len(y), 1))
    points[..., first] += half[first] * x[:, None]
    points[..., second] += half[second] * y
    area = np.outer(dx, dy) * half[first] * half[second]
    material = box.material.permittivity
    assert material is not None
    h = np.empty((len(antennas_m), len(frequencies_hz)), dtype=complex)
    for row, antenna in enumerate(antennas_m):
        way = antenna - points
        distance = np.linalg.norm(way, axis=-1)
        u = way / distance[..., None]
        # inner faces look at the middle of the box, and the lid at the antennas
        sign = (
            np.sign(np.asarray(box.middle_min_m + box.middle_max_m)[axis] / 2 - middle[axis])
            if inside
            else 1.0
        )
        cosine = np.maximum(sign * u[..., axis], 1e-9)
        for column, f in enumerate(frequencies_hz):
            eps = material.at(float(f))
            weight = _split(u, axis, *slab_reflection(eps, box.thickness_m, cosine, f))
            if inside:
                through = slab_transmission(eps, box.thickness_m, u[..., 2], f)
                bent = refraction_factor(eps, box.thickness_m, u[..., 2], distance, f)
                weight = weight * _split(u, 2, (through.s * bent) ** 2, (through.p * bent) ** 2)
            lit = area * cosine / distance**2 * (sign * u[..., axis] > 0)
            phase = np.exp(-4j * np.pi * f / SPEED_OF_LIGHT_M_PER_S * distance)
            h[row, column] = 1j / (4 * np.pi) * (weight * lit * phase).sum()
    return h


def _split(u: FloatArray, axis: int, s: ComplexArray, p: ComplexArray) -> ComplexArray:
    """Both polarisations by the share of E, transverse and nearest to y, that lies across the plane of incidence."""
    field = np.array([0.0, 1.0, 0.0]) - u[..., 1:2] * u
    across = np.cross(u, np.eye(3)[axis])
    share = (field * across).sum(axis=-1) ** 2
    share /= np.maximum((field**2).sum(axis=-1) * (across**2).sum(axis=-1), 1e-30)
    return np.asarray(s * share + p * (1 - share))
