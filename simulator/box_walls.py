"""The walls of a box as reflecting surfaces, cut into flat rectangles.

A wall is flat, so pieces of 0.8 wavelengths are enough where each is weighed with the form factor of its rectangle
(`response`): 0.5 % of the echo of a box 0.2 m away. Triangles of a third of a wavelength would be ten times as many.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.occluders import Box
from waveformer.simulator.quadrature import SurfaceSamples


def wall_pieces(
    box: Box,
    edge_m: float,
    antennas_m: NDArray[np.float64],
    *,
    inside: bool,
    counts: NDArray[np.int64] | None = None,
) -> tuple[SurfaceSamples, NDArray[np.float64]]:
    """Rectangles of the six outer or inner faces, but for faces that no antenna looks at.

    Args:
        box: the box.
        edge_m: longest edge of a rectangle.
        antennas_m: all antennas, shape (A, 3).
        inside: the inner faces, normals inwards; otherwise the outer ones, normals outwards.
        counts: rectangles along x, y and z, shape (3,); None for as many as the edge asks for.

    Returns:
        The samples, and the edges of every rectangle along x, y and z, shape (3,): the edge along a wall's normal
        has no meaning.
    """
    inset = box.thickness_m if inside else 0.0
    low, high = np.asarray(box.min_m) + inset, np.asarray(box.max_m) - inset
    if counts is None:
        counts = np.ceil((high - low) / edge_m).astype(np.int64)
    edges = (high - low) / counts
    ticks = [low[axis] + (np.arange(counts[axis]) + 0.5) * edges[axis] for axis in range(3)]
    points, normals, areas = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    for axis in range(3):
        first, second = (other for other in range(3) if other != axis)
        for place, outwards in ((low[axis], -1.0), (high[axis], 1.0)):
            normal = np.zeros(3)
            normal[axis] = -outwards if inside else outwards
            if not ((antennas_m[:, axis] - place) * normal[axis] > 0).any():
                continue
            face = np.empty((counts[first], counts[second], 3))
            face[..., axis] = place
            face[..., first], face[..., second] = np.meshgrid(ticks[first], ticks[second], indexing="ij")
            points.append(face.reshape(-1, 3))
            normals.append(np.tile(normal, (len(points[-1]), 1)))
            areas.append(np.full(len(points[-1]), edges[first] * edges[second]))
    area = np.concatenate(areas)
    samples = SurfaceSamples(np.concatenate(points), np.concatenate(normals), area, np.zeros(len(area)))
    return samples, edges
