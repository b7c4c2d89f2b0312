"""Candidate surfaces: level sets of a component's potential, as voxels (Eq. 6) or as sub-voxel points.

The sub-voxel surface is a height field. In every (x, y) column it lies at the highest place where f rises
through the level, which is what a radar above sees, and is a patch of the tangent plane there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.model.normals import gradient_normals
from waveformer.model.voxels import cubic_edge_m, voxel_edges_m, voxel_positions_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

# A height field cannot show a steeper sheet: at 78 degrees it climbs five voxels from column to column.
STEEPEST_COSINE = 0.2
_SUB_POINTS = 3


@dataclass(frozen=True, eq=False)
class PotentialField:
    """The potential of one component; its voxels are brought into C order.

    Attributes:
        grid: the voxels, evenly spaced along each axis.
        index: voxels (i, j, k) of the component, shape (V, 3), each once.
        potential_m: f, shape (V,), metres, grows towards the radar.
        normals: of unit length, towards the radar, shape (V, 3); None = the field's gradient.
    """

    grid: Grid
    index: NDArray[np.int64]
    potential_m: NDArray[np.float64]
    normals: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        index = np.array(self.index)
        if index.ndim != 2 or index.shape[1] != 3 or len(index) == 0 or index.dtype.kind not in "iu":
            raise RadarError(f"potential field index must be integers of shape (V, 3), got {index.shape}")
        if (index < 0).any() or (index >= self.grid.shape).any():
            raise RadarError(f"potential field index reaches beyond the grid of {self.grid.shape} voxels")
        flat = np.ravel_multi_index(tuple(index.T), self.grid.shape)
        order = np.argsort(flat, kind="stable")
        if (np.diff(flat[order]) == 0).any():
            raise RadarError("potential field index lists a voxel twice")
        arrays: dict[str, NDArray[np.generic]] = {"index": index.astype(np.int64)[order]}
        for name, shape in (("potential_m", (len(index),)), ("normals", (len(index), 3))):
            if (given := getattr(self, name)) is None:
                continue
            values = np.array(given, dtype=np.float64)
            if values.shape != shape or not np.isfinite(values).all():
                raise RadarError(f"potential field {name} must be finite and of shape {shape}")
            arrays[name] = values[order]
        for name, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)


@dataclass(frozen=True, eq=False)
class SurfacePatch:
    """Points of one surface.

    Attributes:
        points_m: shape (P, 3).
        normals: unit vectors towards the radar, shape (P, 3).
        areas_m2: area that each point stands for, shape (P,).
    """

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    areas_m2: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SurfaceStack(SurfacePatch):
    """Points of the surfaces at many levels, level after level.

    Attributes:
        level: position in the list of levels, shape (P,), ascending.
    """

    level: NDArray[np.int64]

    def points_at(self, level: int) -> NDArray[np.float64]:
        """Points of one level by its position in the list, shape (p, 3)."""
        first, end = np.searchsorted(self.level, [level, level + 1])
        return self.points_m[first:end]


def levels(
    field: PotentialField,
    wavelength_m: float,
    step_m: float | None = None,
    margin_m: float = 0.0,
    drop_deepest: int = 0,
) -> NDArray[np.float64]:
    """Values of f at which candidate surfaces are taken, ascending, shape (L,).

    Args:
        field: one component.
        wavelength_m: at the start of the chirp.
        step_m: distance of the levels; None = half a wavelength.
        margin_m: left out at both ends of f's range; mmNorm leaves out 0.015.
        drop_deepest: levels left out at the far end; mmNorm drops 15.

    Returns:
        Empty if the margin leaves nothing.

    Raises:
        RadarError: the wavelength or the step is not positive, or a margin is negative.
    """
    step = wavelength_m / 2 if step_m is None else step_m
    if not (np.isfinite(step) and step > 0):
        raise RadarError(f"levels need a positive step in metres, got {step!r}")
    if not margin_m >= 0 or drop_deepest < 0:
        raise RadarError(f"levels need margins that are not negative, got {margin_m!r} and {drop_deepest!r}")
    low, high = field.potential_m.min() + margin_m, field.potential_m.max() - margin_m
    count = max(0, int(np.floor((high - low) / step + 1e-9)) + 1)
    return np.asarray(low + step * np.arange(drop_deepest, max(count, drop_deepest)))


def voxel_points(field: PotentialField, level_m: float, delta_m: float | None = None) -> NDArray[np.float64]:
    """Centres of the voxels with |f - level| < delta (Eq. 6), shape (P, 3), metres.

    Args:
        field: one component.
        level_m: the level.
        delta_m: half the thickness; None = the edge of a voxel, which must be a cube.

    Raises:
        RadarError: delta is None and the voxels are not cubes.
    """
    delta = cubic_edge_m(field.grid) if delta_m is None else delta_m
    near = np.abs(field.potential_m - level_m) < delta
    return voxel_positions_m(field.grid, field.index[near])


def surface_points(field: PotentialField, level_m: float) -> SurfacePatch:
    """Sub-voxel points of one level, see `all_surface_points`."""
    stack = all_surface_points(field, np.array([level_m]))
    return SurfacePatch(stack.points_m, stack.normals, stack.areas_m2)


def all_surface_points(field: PotentialField, levels_m: NDArray[np.float64]) -> SurfaceStack:
    """Sub-voxel points of all levels: 3 x 3 for each column that a level passes.

    The crossing is interpolated linearly between two voxels, one above the other, both of the component: a gap
    in a column is not bridged. The points of a column lie in the tangent plane and share its area / |n_z|.
    Normals steeper than 78 degrees are raised to it.

    Args:
        field: one component.
        levels_m: ascending, shape (L,).

    Returns:
        The points, level after level; none for a level without a crossing.

    Raises:
        RadarError: the levels are not finite and ascending, or the grid is not regular.
    """
    values = np.asarray(levels_m, dtype=np.float64)
    if values.ndim != 1 or not np.isfinite(values).all() or (np.diff(values) <= 0).any():
        raise RadarError("levels_m must be finite and ascending, of shape (L,)")
    edges = voxel_edges_m(field.grid)
    below, level = _crossings(field, values)
    f_below, f_above = field.potential_m[below], field.potential_m[below + 1]
    share = ((values[level] - f_below) / (f_above - f_below))[:, None]
    normals = field_normals(field)
    tangent = _raised((1 - share) * normals[below] + share * normals[below + 1])
    points = voxel_positions_m(field.grid, field.index[below])
    points += share * np.array([0.0, 0.0, edges[2]])

    offsets = (np.arange(_SUB_POINTS) - (_SUB_POINTS - 1) / 2) / _SUB_POINTS
    across = np.stack(np.meshgrid(offsets * edges[0], offsets * edges[1], indexing="ij"), axis=-1).reshape(
        -1, 2
    )
    spread = np.empty((len(points), len(across), 3))
    spread[:, :, :2] = points[:, None, :2] + across
    spread[:, :, 2] = points[:, 2:] - (tangent[:, :2] / tangent[:, 2:]) @ across.T
    areas = edges[0] * edges[1] / len(across) / tangent[:, 2]
    copies = len(across)
    return SurfaceStack(
        spread.reshape(-1, 3),
        np.repeat(tangent, copies, axis=0),
        np.repeat(areas, copies),
        np.repeat(level, copies),
    )


def field_normals(field: PotentialField) -> NDArray[np.float64]:
    """Unit normals of the field's voxels: those given, else the gradient of f, shape (V, 3)."""
    if field.normals is not None:
        return field.normals
    return gradient_normals(field.potential_m, field.index, field.grid)


def sample_points(points_m: NDArray[np.float64], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Exactly `count` points of a cloud, drawn at random, shape (count, 3).

    A larger cloud is thinned without replacement, which keeps its density. A smaller one is repeated: every
    point equally often, give or take one.

    Args:
        points_m: shape (P, 3).
        count: at least 1.
        rng: its state decides which points.

    Raises:
        RadarError: there is no point, or count is not positive.
    """
    if points_m.ndim != 2 or points_m.shape[1] != 3 or len(points_m) == 0:
        raise RadarError(f"sampling needs points of shape (P, 3) with P >= 1, got {points_m.shape}")
    if count < 1:
        raise RadarError(f"the number of points to sample must be at least 1, got {count!r}")
    whole, rest = divmod(count, len(points_m))
    drawn = rng.choice(len(points_m), size=rest, replace=False)
    chosen = np.concatenate([np.tile(np.arange(len(points_m)), whole), drawn])
    return np.asarray(points_m[chosen])


def _crossings(
    field: PotentialField, values: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Voxel below the highest rise of each column through each level, and the level; level after level."""
    index, potential = field.index, field.potential_m
    # In C order the voxel above follows at once, if it belongs to the component.
    stacked = np.append((np.diff(index, axis=0) == (0, 0, 1)).all(axis=1), False)
    below = np.flatnonzero(stacked)
    start = np.searchsorted(values, potential[below], side="left")
    stop = np.searchsorted(values, potential[below + 1], side="left")
    counts = np.maximum(0, stop - start)
    below = np.repeat(below, counts)
    level = np.arange(len(below)) + np.repeat(start - np.cumsum(counts) + counts, counts)
    column = np.cumsum(np.append(True, (np.diff(index[:, :2], axis=0) != 0).any(axis=1)))[below]
    # By level, then column; the last of each pair is the highest, since rows ascend.
    key = level * (len(index) + 1) + column
    order = np.argsort(key, kind="stable")
    highest = order[np.append(np.diff(key[order]) != 0, True)[: len(order)]]
    return below[highest], level[highest]


def _raised(normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors no steeper than a height field can show."""
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = np.where(length > 0, normals / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0))
    steep = unit[:, 2] < STEEPEST_COSINE
    sideways = np.hypot(unit[steep, 0], unit[steep, 1])
    scale = np.sqrt(1 - STEEPEST_COSINE**2) / np.where(sideways > 0, sideways, 1.0)
    unit[steep, :2] *= scale[:, None]
    unit[steep, 2] = np.where(sideways > 0, STEEPEST_COSINE, 1.0)
    return np.asarray(unit)
