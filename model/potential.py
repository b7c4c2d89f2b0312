"""The potential f of a component: a height in metres that grows towards the radar along the normals.

Level sets of f are the candidate surfaces (Eq. 5). f is known up to a constant and is zero at the voxel closest
to the component's centroid.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.model.components import NEIGHBOURS, neighbour_table
from waveformer.model.normals import component_normals
from waveformer.model.voxels import voxel_edges_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

RESIDUAL_TOLERANCE = 1e-8
_MAXIMUM_ITERATIONS = 20_000


def integrate_breadth_first(
    normals: NDArray[np.floating], component: NDArray[np.int64], grid: Grid
) -> NDArray[np.float64]:
    """Potential by path integration, breadth first from the central voxel (mmNorm, Eq. 5).

    The first visit fixes a value, f(w) = f(v) + step . N(w) with the normal of the voxel arrived at. Whole
    generations are visited at once, in the order of a first-in first-out queue, so the values are those of
    `reference_potential.integrate_breadth_first`.

    Args:
        normals: shape (X, Y, Z, 3), pointing to the radar, of any length; NaN outside the component is fine.
        component: voxels (i, j, k), shape (V, 3), 6-connected.
        grid: the voxels; edges may differ between the axes.

    Returns:
        f in metres, shape (V,).

    Raises:
        RadarError: a voxel has no normal, the component falls apart, or the grid is not regular.
    """
    edges = voxel_edges_m(grid)
    steps = component_normals(normals, component) * edges
    # Rise on arrival from each side; row V stands for "no neighbour".
    rise = np.stack([sign * steps[:, axis] for axis, sign in _signed_axes()], axis=1)
    neighbours = neighbour_table(component)
    size = len(component)
    potential = np.zeros(size)
    visited = np.zeros(size + 1, dtype=bool)
    visited[size] = True
    first = np.empty(size + 1, dtype=np.int64)
    frontier = np.array([central_voxel(component, edges)])
    visited[frontier] = True
    directions = np.arange(6)
    while len(frontier):
        reached = neighbours[frontier].reshape(-1)
        open_ = np.flatnonzero(~visited[reached])
        arrivals = reached[open_]
        # Of several arrivals at one voxel the first in the queue counts: written last, it stays.
        first[arrivals[::-1]] = open_[::-1]
        winners = open_[first[arrivals] == open_]
        parents, frontier = frontier[winners // 6], reached[winners]
        potential[frontier] = potential[parents] + rise[frontier, directions[winners % 6]]
        visited[frontier] = True
    _require_connected(visited[:size])
    return potential


def integrate_least_squares(
    normals: NDArray[np.floating],
    weights: NDArray[np.floating],
    component: NDArray[np.int64],
    grid: Grid,
) -> NDArray[np.float64]:
    """Potential whose differences fit the normals best: a weighted Poisson equation.

    Minimises sum over neighbours (v, w) of (q_v + q_w)/2 * ((f_w - f_v)/d - n . (N_v + N_w)/2)^2, with d their
    distance and n the axis, by conjugate gradients to a relative residual of 1e-8.

    Args:
        normals, component, grid: as in `integrate_breadth_first`.
        weights: q, shape (X, Y, Z), e.g. |S|; positive within the component.

    Returns:
        f in metres, shape (V,), zero at the same voxel as the breadth-first potential.

    Raises:
        RadarError: as `integrate_breadth_first`; also for weights that are not positive.
    """
    from scipy import sparse
    from scipy.sparse import csgraph
    from scipy.sparse.linalg import cg

    edges = voxel_edges_m(grid)
    directions = component_normals(normals, component)
    if np.shape(weights) != np.shape(normals)[:3]:
        raise RadarError(f"weights of shape {np.shape(weights)} do not fit normals of {np.shape(normals)}")
    quality = np.asarray(weights)[tuple(component.T)].astype(np.float64)
    if not (np.isfinite(quality).all() and (quality > 0).all()):
        raise RadarError("weights must be finite and positive within the component")
    quality /= quality.max()
    size = len(component)
    if size == 1:
        return np.zeros(1)
    neighbours = neighbour_table(component)
    lower, upper, conductance, difference = [], [], [], []
    for column, (axis, sign) in enumerate(_signed_axes()):
        if sign < 0:
            continue
        start = np.flatnonzero(neighbours[:, column] < size)
        end = neighbours[start, column]
        lower.append(start)
        upper.append(end)
        conductance.append((quality[start] + quality[end]) / 2 * (edges.min() / edges[axis]) ** 2)
        difference.append((directions[start, axis] + directions[end, axis]) / 2 * edges[axis])
    low, high = np.concatenate(lower), np.concatenate(upper)
    strength, rise = np.concatenate(conductance), np.concatenate(difference)
    links = sparse.csr_array((strength, (low, high)), shape=(size, size))
    count, _ = csgraph.connected_components(links, directed=False)
    _require_connected(np.arange(count) == 0)
    diagonal = np.bincount(low, strength, size) + np.bincount(high, strength, size)
    laplacian = sparse.diags_array(diagonal) - links - links.T
    flux = np.bincount(high, strength * rise, size) - np.bincount(low, strength * rise, size)
    center = central_voxel(component, edges)
    # The constant is free: the system is singular but consistent, which conjugate gradients take as it is.
    solution, failed = cg(
        laplacian,
        flux,
        rtol=RESIDUAL_TOLERANCE,
        maxiter=_MAXIMUM_ITERATIONS,
        M=sparse.diags_array(1 / diagonal),
    )
    if failed:
        raise RadarError(f"least squares did not settle on {size} voxels: use the breadth-first potential")
    return np.asarray(solution - solution[center])


def central_voxel(component: NDArray[np.int64], edges_m: NDArray[np.float64]) -> int:
    """Row of the voxel closest to the component's mean position; the first one in order of a tie."""
    # Whole numbers until the last step, so that ties are ties.
    offset = (len(component) * component - component.sum(axis=0)) * edges_m
    squared = offset[:, 0] ** 2 + offset[:, 1] ** 2 + offset[:, 2] ** 2
    return int(np.argmin(squared))


def _signed_axes() -> list[tuple[int, int]]:
    return [(int(np.flatnonzero(step)[0]), int(step.sum())) for step in NEIGHBOURS]


def _require_connected(reached: NDArray[np.bool_]) -> None:
    if not reached.all():
        raise RadarError("the component is not 6-connected: pass one component of connected_components")
