"""Slow, obvious float64 twins of the potential's integration: a queue, and a dense least-squares solve."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.grid import Grid

_STEPS = ((-1, 0, 0), (0, 1, 0), (1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
Voxel = tuple[int, int, int]


def integrate_breadth_first(
    normals: NDArray[np.floating], component: NDArray[np.int64], grid: Grid
) -> NDArray[np.float64]:
    """`potential.integrate_breadth_first`, voxel by voxel through a first-in first-out queue."""
    voxels = _voxels(component)
    edges = _edges(grid)
    start = min(voxels, key=lambda voxel: _squared_offset(voxel, voxels, edges))
    potential = {start: 0.0}
    queue = deque([start])
    while queue:
        voxel = queue.popleft()
        for step in _STEPS:
            arrival = (voxel[0] + step[0], voxel[1] + step[1], voxel[2] + step[2])
            if arrival not in voxels or arrival in potential:
                continue
            normal = normals[arrival].astype(np.float64)
            normal = normal / np.sqrt(np.sum(normal * normal))
            potential[arrival] = potential[voxel] + float(np.dot(step, normal * edges))
            queue.append(arrival)
    return np.array([potential[voxel] for voxel in voxels])


def integrate_least_squares(
    normals: NDArray[np.floating],
    weights: NDArray[np.floating],
    component: NDArray[np.int64],
    grid: Grid,
) -> NDArray[np.float64]:
    """`potential.integrate_least_squares`, by a dense solve; the constant is fixed at the same voxel."""
    voxels = _voxels(component)
    edges = _edges(grid)
    equations, values = [], []
    for voxel, row in voxels.items():
        for axis in range(3):
            neighbour = (voxel[0] + (axis == 0), voxel[1] + (axis == 1), voxel[2] + (axis == 2))
            if neighbour not in voxels:
                continue
            slope = 0.0
            for end in (voxel, neighbour):
                slope += float(normals[end][axis] / np.linalg.norm(normals[end])) / 2
            scale = np.sqrt((float(weights[voxel]) + float(weights[neighbour])) / 2)
            equation = np.zeros(len(voxels))
            equation[voxels[neighbour]], equation[row] = scale / edges[axis], -scale / edges[axis]
            equations.append(equation)
            values.append(scale * slope)
    start = min(voxels, key=lambda voxel: _squared_offset(voxel, voxels, edges))
    solution = np.linalg.lstsq(np.array(equations), np.array(values), rcond=None)[0]
    return np.asarray(solution - solution[voxels[start]])


def _voxels(component: NDArray[np.int64]) -> dict[Voxel, int]:
    return {(int(i), int(j), int(k)): row for row, (i, j, k) in enumerate(component)}


def _edges(grid: Grid) -> NDArray[np.float64]:
    return np.array([(axis[-1] - axis[0]) / (len(axis) - 1) for axis in (grid.x, grid.y, grid.z)])


def _squared_offset(voxel: Voxel, voxels: dict[Voxel, int], edges: NDArray[np.float64]) -> float:
    """Squared distance from the mean position, times the squared number of voxels: ties stay ties."""
    offset = [
        (len(voxels) * voxel[axis] - sum(other[axis] for other in voxels)) * float(edges[axis])
        for axis in range(3)
    ]
    return offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2
