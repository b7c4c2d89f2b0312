"""Ground truth of a mesh: points on its outer surface, with their normals."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh

NUM_POINTS = 16_384

# A point belongs to the outer surface if it sees the sky in at least 1 % of a hemisphere. Inner shells of scans
# see nothing, or a speck through a lost triangle (0.02 % for 3 mm at 60 mm); the bottom of a pitcher, 23 cm deep
# and 10 cm wide, sees 2 %.
_DIRECTIONS = 512
_MIN_SEEN = 3
# Convex parts are decided after the first of these shares; only what has seen little is tested further.
_STRIDES = (64, 16, 4, 1)
# Far enough that the directions are the same for all points, near enough for float32 rays.
_SKY_RADII = 100.0
_MIN_OUTER_SHARE = 0.01


def sample_ground_truth(
    mesh: SurfaceMesh, rng: np.random.Generator, count: int = NUM_POINTS, *, scene: Any = None
) -> TruthCloud:
    """Points distributed evenly by area over the outer surface of a mesh, with the normals of their faces.

    Outer is what can be seen from far away from some direction: cavities with an opening belong to it, shells
    inside a closed hull do not.

    Args:
        mesh: in the frame that the points shall have.
        rng: random numbers.
        count: number of points.
        scene: of `simulator.scene.build_scene` with this mesh alone, if it is there already.

    Raises:
        MeshError: ``mesh.no_outer_surface``: less than 1 % of the area can be seen from outside.
    """
    sky = _Sky(mesh, scene)
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

    def __init__(self, mesh: SurfaceMesh, scene: Any) -> None:
        from waveformer.simulator.scene import build_scene

        self._scene = build_scene([(mesh.vertices_m, mesh.faces)]) if scene is None else scene
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        radius_m = _SKY_RADII * np.linalg.norm(high - low)
        self._positions_m = (low + high) / 2 + radius_m * _even_directions(_DIRECTIONS)

    def sees(self, points_m: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether points of the surface, from whichever side, see at least `_MIN_SEEN` directions, (P,)."""
        from waveformer.simulator.scene import VISIBLE, SampleTable, sample_states

        table = SampleTable(points_m, normals)
        seen = np.zeros(len(points_m), dtype=np.int64)
        tested = np.zeros(_DIRECTIONS, dtype=bool)
        for stride in _STRIDES:
            share = np.zeros(_DIRECTIONS, dtype=bool)
            share[::stride] = True
            positions_m = self._positions_m[share & ~tested]
            undecided = np.flatnonzero(seen < _MIN_SEEN)
            states = sample_states(self._scene, table, True, positions_m, None, members=undecided)
            seen[undecided] += (states == VISIBLE).sum(axis=0)
            tested |= share
        return seen >= _MIN_SEEN


def _even_directions(count: int) -> NDArray[np.float64]:
    """Unit vectors on a Fibonacci spiral, (count, 3)."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (1 + np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
