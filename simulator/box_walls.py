"""The walls of a box as reflecting surfaces: their outer and their inner faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.occluders import Box

# Corners of the unit cube as x + 2 y + 4 z, and its faces as pairs of triangles wound outwards.
_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=np.float64)
_QUADS = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
_FACES = np.array([triangle for a, b, c, d in _QUADS for triangle in ((a, b, c), (a, c, d))])


def outer_faces(box: Box) -> SurfaceMesh:
    """The six outer faces, normals outwards: a way from one of them to an antenna before it crosses nothing."""
    return _cuboid(np.asarray(box.min_m), np.asarray(box.max_m), _FACES, "box (outside)")


def inner_faces(box: Box) -> SurfaceMesh:
    """The six inner faces, normals inwards: a way from one of them leaves through another wall."""
    low, high = np.asarray(box.min_m) + box.thickness_m, np.asarray(box.max_m) - box.thickness_m
    return _cuboid(low, high, _FACES[:, ::-1], "box (inside)")


def _cuboid(
    low: NDArray[np.float64], high: NDArray[np.float64], faces: NDArray[np.int64], name: str
) -> SurfaceMesh:
    return SurfaceMesh(low + _CORNERS * (high - low), faces, name, two_sided=False)
