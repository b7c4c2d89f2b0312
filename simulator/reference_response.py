"""NumPy float64 twin of `response`: the factor W of every pair, step by step and way by way."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Box
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.response_plan import Crossings, ResponsePlan, wall_reflection, wall_transmission
from waveformer.simulator.slab import coherent_loss
from waveformer.simulator.surroundings import Surroundings


def pair_response(
    plan: ResponsePlan,
    frequency_hz: float,
    points_m: ArrayLike,
    normals: ArrayLike,
    tx_m: ArrayLike,
    rx_m: ArrayLike,
) -> NDArray[np.complex128]:
    """W of pairs of sample and antennas.

    Args:
        plan: what W consists of; the frequencies of the plan do not matter here.
        frequency_hz: one frequency.
        points_m, normals: samples (..., 3).
        tx_m, rx_m: antennas (..., 3) that broadcast with them.

    Returns:
        The broadcast shape.
    """
    material, surroundings = plan.material, plan.surroundings
    points, normals, tx, rx = np.broadcast_arrays(points_m, normals, tx_m, rx_m)
    polarization = np.asarray(surroundings.polarization)
    directions = [_unit(antenna - points) for antenna in (tx, rx)]
    fields = [_unit(polarization - _dot(polarization, u)[..., None] * u) for u in directions]
    cosine = np.abs(0.5 * sum(_dot(normals, u) for u in directions))
    shares = [_dot(e, _unit(np.cross(u, normals))) ** 2 for e, u in zip(fields, directions, strict=True)]
    share_s = 0.5 * (shares[0] + shares[1])
    gamma = wall_reflection(material, cosine, frequency_hz)
    weight = gamma.s * share_s + gamma.p * (1.0 - share_s)
    weight = weight * coherent_loss(material.roughness_m, cosine, frequency_hz)
    carried = [
        field_behind(surroundings, plan.crossings, frequency_hz, points, antenna, u, e)
        for antenna, u, e in zip((tx, rx), directions, fields, strict=True)
    ]
    weight = weight * _dot(carried[0], carried[1]) / _dot(fields[0], fields[1])
    if plan.facet_m is not None:
        weight = weight * _form_factor(plan.facet_m, frequency_hz, points, normals, (tx, rx))
    for u in directions:
        weight = weight * surroundings.antenna.amplitude(u)
    return np.asarray(weight)


def _form_factor(
    facet_m: NDArray[np.float64],
    frequency_hz: float,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    antennas: tuple[NDArray[np.float64], ...],
) -> NDArray[np.complex128]:
    """Mean of the integrand over a rectangle, over its value in the middle: 8 Gauss points an axis, nothing expanded."""
    nodes, shares = np.polynomial.legendre.leggauss(8)

    def value(places: NDArray[np.float64]) -> NDArray[np.complex128]:
        total = np.zeros(places.shape[:-1])
        product, path = np.ones_like(total), np.zeros_like(total)
        for antenna in antennas:
            way = antenna - places
            distance = np.linalg.norm(way, axis=-1)
            total, product, path = total + _dot(way, normals) / distance, product * distance, path + distance
        return np.asarray(
            total / product * np.exp(-2j * np.pi * frequency_hz / SPEED_OF_LIGHT_M_PER_S * path)
        )

    edges = facet_m * (1.0 - np.abs(normals))
    mean = np.zeros(points.shape[:-1], dtype=np.complex128)
    for i, j, k in np.ndindex(len(nodes), len(nodes), len(nodes)):  # along the normal all are the same point
        mean += 0.125 * shares[i] * shares[j] * shares[k] * value(points + 0.5 * edges * nodes[[i, j, k]])
    return np.asarray(mean / value(points))


def field_behind(
    surroundings: Surroundings,
    crossings: Crossings,
    frequency_hz: float,
    points: NDArray[np.float64],
    antenna: NDArray[np.float64],
    direction: NDArray[np.float64],
    field: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """The unit field of an antenna after all sheets and walls between it and the points, (..., 3)."""
    carried = field.astype(np.complex128)
    distance = np.linalg.norm(antenna - points, axis=-1)
    for sheet in surroundings.sheets:
        normal = np.asarray(sheet.normal)
        sides = [_dot(place - np.asarray(sheet.point_m), normal) for place in (points, antenna)]
        behind = _through(carried, direction, distance, normal, sheet.material, frequency_hz)
        carried = np.where((sides[0] * sides[1] < 0)[..., None], behind, carried)
    if surroundings.box is None or crossings == "none":
        return carried
    for crosses, normal in _walls_met(surroundings.box, points, antenna, crossings):
        behind = _through(carried, direction, distance, normal, surroundings.box.material, frequency_hz)
        carried = np.where(crosses[..., None], behind, carried)
    return carried


def _through(
    carried: NDArray[np.complex128],
    direction: NDArray[np.float64],
    distance_m: NDArray[np.float64],
    normal: NDArray[np.float64],
    wall: Material,
    frequency_hz: float,
) -> NDArray[np.complex128]:
    transmit = wall_transmission(wall, np.abs(_dot(direction, normal)), distance_m, frequency_hz)
    across = _unit(np.cross(direction, normal))
    along_s = _dot(carried, across)[..., None] * across
    return np.asarray(transmit.s[..., None] * along_s + transmit.p[..., None] * (carried - along_s))


def _walls_met(
    box: Box, points: NDArray[np.float64], antenna: NDArray[np.float64], crossings: Crossings
) -> list[tuple[NDArray[np.bool_], NDArray[np.float64]]]:
    """(whether, wall normal) for the wall of entry and the wall of leaving."""
    way = antenna - points
    way = np.where(np.abs(way) > 1e-9, way, 1e-9)
    ends = np.sort(np.stack([(box.middle_min_m - points) / way, (box.middle_max_m - points) / way]), axis=0)
    entry, leave = ends[0].max(axis=-1), ends[1].min(axis=-1)
    met = []
    for fraction, axis in ((entry, ends[0].argmax(axis=-1)), (leave, ends[1].argmin(axis=-1))):
        met.append(((entry < leave) & (fraction > 0) & (fraction < 1), np.eye(3)[axis]))
    return met[1:] if crossings == "leaving" else met


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 1e-6, vectors / np.where(length > 1e-6, length, 1.0), 0.0))


def _dot(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    return np.asarray((one * other).sum(axis=-1))
