"""Ground truth of a mesh: points on its outer surface, and the level of a field that lies nearest to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.eval.truth_cloud import TruthCloud
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.mesh import SurfaceMesh

NUM_POINTS = 16_384

# A point belongs to the outer surface if it sees the sky in at least 1 % of a hemisphere. Inner shells of scans
# see nothing, or a speck through a lost triangle (0.02 % for 3 mm at 60 mm); the bottom of a pitcher, 23 cm deep
# and 10 cm wide, sees 2 %.
_DIRECTIONS = 512
_MIN_SEEN = 3
# Convex parts are decided after these; only what sees little is tested in all directions.
_FIRST_DIRECTIONS = 32
# Far enough that the directions are the same for all points, near enough for float32 rays.
_SKY_RADII = 100.0
_MIN_OUTER_SHARE = 0.01


def sample_ground_truth(mesh: SurfaceMesh, rng: np.random.Generator, count: int = NUM_POINTS) -> TruthCloud:
    """Points distributed evenly by area over the outer surface of a mesh, with the normals of their faces.

    Outer is what can be seen from far away from some direction: cavities with an opening belong to it, shells
    inside a closed hull do not.

    Args:
        mesh: in the frame that the points shall have.
        rng: random numbers.
        count: number of points.

    Raises:
        MeshError: ``mesh.no_outer_surface``: less than 1 % of the area can be seen from outside.
    """
    sky = _Sky(mesh)
    points: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    drawn = kept = 0
    while kept < count:
        if drawn >= count and kept < _MIN_OUTER_SHARE * drawn:
            raise MeshError(
                "mesh.no_outer_surface",
                f"{mesh.name}: only {kept} of {drawn} surface points can be seen from outside; "
                "is the object inside a closed hull?",
            )
        share = max(kept / drawn, _MIN_OUTER_SHARE) if drawn else 1.0
        batch = min(4 * count, int(np.ceil((count - kept) / share)))
        batch_m, face = _sample_by_area(mesh, batch, rng)
        outer = sky.sees(batch_m, mesh.normals[face])
        points.append(batch_m[outer])
        faces.append(face[outer])
        drawn += batch
        kept += int(outer.sum())
    face = np.concatenate(faces)[:count]
    return TruthCloud(np.concatenate(points)[:count], mesh.normals[face])


def reference_level(
    potential_m: ArrayLike, distance_m: ArrayLike, levels_m: ArrayLike, delta_m: float
) -> int:
    """The level of a field that is nearest to the mesh: least median |signed distance| of its voxels.

    Args:
        potential_m: field f at the voxels of a component, (V,).
        distance_m: signed distance of the same voxels to the mesh, (V,): one query serves all levels.
        levels_m: (L,).
        delta_m: a voxel belongs to a level if |f - level| is less than this (Eq. 6 of the paper).

    Returns:
        Index of the level; of equal ones the first.

    Raises:
        RadarError: no voxel belongs to any level, or the sizes disagree.
    """
    potential, distance, levels = (
        np.asarray(values, dtype=np.float64) for values in (potential_m, distance_m, levels_m)
    )
    if potential.shape != distance.shape:
        raise RadarError(f"{potential.size} potentials for {distance.size} distances")
    medians = np.full(len(levels), np.inf)
    for index, level in enumerate(levels):
        near = np.abs(potential - level) < delta_m
        if near.any():
            medians[index] = np.median(np.abs(distance[near]))
    if not np.isfinite(medians).any():
        raise RadarError(f"none of {len(levels)} levels has a voxel within {delta_m:g} m")
    return int(medians.argmin())


def _sample_by_area(
    mesh: SurfaceMesh, count: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Uniform points (count, 3) and their faces (count,)."""
    area_up_to = np.cumsum(mesh.areas_m2)
    face = np.searchsorted(area_up_to, rng.random(count) * area_up_to[-1], side="right")
    face = np.minimum(face, len(mesh.faces) - 1)
    # A uniform point of a triangle: Osada et al. 2002, "Shape distributions", Eq. 1.
    first, second = rng.random((2, count, 1))
    first = np.sqrt(first)
    corners = mesh.triangles_m[face]
    points = (1 - first) * corners[:, 0] + first * (1 - second) * corners[:, 1]
    return points + first * second * corners[:, 2], face


class _Sky:
    """Rays from points to a fixed set of far away directions."""

    def __init__(self, mesh: SurfaceMesh) -> None:
        from waveformer.simulator.scene import build_scene

        self._scene = build_scene([(mesh.vertices_m, mesh.faces)])
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        positions = (low + high) / 2 + _SKY_RADII * np.linalg.norm(high - low) * _even_directions(_DIRECTIONS)
        first = np.arange(0, _DIRECTIONS, _DIRECTIONS // _FIRST_DIRECTIONS)
        self._first, self._others = positions[first], np.delete(positions, first, axis=0)

    def sees(self, points_m: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points of the surface, from whichever side, see at least `_MIN_SEEN` directions, (P,)."""
        from waveformer.simulator.scene import VISIBLE, SampleTable, sample_states

        table = SampleTable(points_m, normals)
        seen = (sample_states(self._scene, table, True, self._first, None) == VISIBLE).sum(axis=0)
        rest = np.flatnonzero(seen < _MIN_SEEN)
        states = sample_states(self._scene, table, True, self._others, None, members=rest)
        seen[rest] += (states == VISIBLE).sum(axis=0)
        return np.asarray(seen >= _MIN_SEEN)


def _even_directions(count: int) -> NDArray[np.float64]:
    """Unit vectors on a Fibonacci spiral, (count, 3)."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (1 + np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
