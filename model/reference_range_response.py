"""Slow, obvious float64 twin of `range_response.range_responses`: every point, every frequency, no bins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.model.range_window import RangeWindow
from waveformer.model.surfaces import SurfaceStack
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp


def range_responses(
    stack: SurfaceStack,
    num_levels: int,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    chirp: Chirp,
    window: RangeWindow,
    coherent: bool = True,
) -> NDArray[np.complex128] | NDArray[np.float64]:
    """Arguments and result as of `range_response.range_responses`, one pair of level and antenna at a time."""
    receivers = tx_m if rx_m is None else rx_m
    range_m, column = window.lattice()
    wavenumber = 2.0 * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    center = 2.0 * np.pi * chirp.center_hz / SPEED_OF_LIGHT_M_PER_S
    to_bins = np.exp(2j * (wavenumber - center)[:, None] * range_m) / chirp.num_samples
    response = np.zeros((num_levels, *window.bins.shape), dtype=np.complex128 if coherent else np.float64)
    for level in range(num_levels):
        points, normals, areas = (
            values[stack.level == level] for values in (stack.points_m, stack.normals, stack.areas_m2)
        )
        for row in range(len(tx_m)):
            ways = [antenna - points for antenna in (tx_m[row], receivers[row])]
            distances = [np.linalg.norm(way, axis=1) for way in ways]
            cosines = [(way * normals).sum(axis=1) / d for way, d in zip(ways, distances, strict=True)]
            lit = (cosines[0] > 0) & (cosines[1] > 0)
            weight = lit * areas * 0.5 * (cosines[0] + cosines[1]) / (distances[0] * distances[1])
            mean_range = 0.5 * (distances[0] + distances[1])
            echoes = np.exp(-2j * mean_range[:, None] * wavenumber) @ to_bins[:, column[row]]
            if coherent:
                response[level, row] = weight @ echoes
            else:
                response[level, row] = (weight**2 / areas) @ np.abs(echoes) ** 2
    return response
