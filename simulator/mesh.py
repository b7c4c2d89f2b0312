"""A mesh that can be simulated: loaded, checked, cleaned, in metres."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh_files import RawTriangles, read_triangles
from waveformer.simulator.mesh_repair import (
    Bodies,
    area_vectors,
    find_bodies,
    largest_side,
    merge_vertices,
    nonzero_area,
    unique_faces,
    used_vertices,
)

if TYPE_CHECKING:
    import os

    import trimesh

MIN_SIDE_M, MAX_SIDE_M = 1e-3, 5.0
_USUAL_SIDE_M = 0.15
_UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """Triangles of one object, finite, non-empty and without zero-area or repeated faces.

    Attributes:
        vertices_m: (V, 3) float64, coincident ones merged.
        faces: (F, 3) int64.
        name: of the file or object, for messages.
        two_sided: False only if every body is closed, wound consistently and has a positive volume, so that
            normals point outwards. Otherwise both sides reflect, and ray tracing alone decides what is lit.
        problems: what was repaired or is odd, one readable line each.
    """

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    name: str
    two_sided: bool
    problems: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, dtype in (("vertices_m", np.float64), ("faces", np.int64)):
            array = np.array(getattr(self, name), dtype=dtype)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @cached_property
    def triangles_m(self) -> NDArray[np.float64]:
        """Corners of every face, shape (F, 3, 3)."""
        return self.vertices_m[self.faces]

    @cached_property
    def _area_vectors(self) -> NDArray[np.float64]:
        return area_vectors(self.triangles_m)

    @cached_property
    def areas_m2(self) -> NDArray[np.float64]:
        """Area of every face, shape (F,)."""
        return np.asarray(np.linalg.norm(self._area_vectors, axis=1))

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Unit normal of every face by the right-hand rule, shape (F, 3)."""
        return self._area_vectors / self.areas_m2[:, None]

    @property
    def extent_m(self) -> NDArray[np.float64]:
        """Sides of the bounding box, shape (3,)."""
        return np.asarray(np.ptp(self.vertices_m, axis=0))


def load_mesh(
    source: str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene | RawTriangles,
    *,
    fix_winding: bool = False,
    unit_m: float = 1.0,
) -> SurfaceMesh:
    """Loads, checks and cleans a mesh.

    Args:
        source: path of a glb, gltf, obj, off, ply or stl file, a trimesh object, or what `read_triangles` read.
        fix_winding: flip closed bodies that are turned inside out instead of refusing the mesh.
        unit_m: length of the source's unit, 0.001 for millimetres.

    Raises:
        MeshError: with the code ``mesh.missing``, ``.unreadable``, ``.archive``, ``.too_big_file``,
            ``.truncated``, ``.empty``, ``.no_faces``, ``.index_range``, ``.nonfinite``, ``.too_large``,
            ``.too_small``, ``.zero_area``, ``.inverted`` or ``.unit``.
    """
    if not (isinstance(unit_m, (int, float)) and np.isfinite(unit_m) and unit_m > 0):
        raise MeshError("mesh.unit", f"unit_m must be a positive number of metres, got {unit_m!r}")
    raw = source if isinstance(source, RawTriangles) else read_triangles(source)
    _require_triangles(raw)
    vertices, faces = used_vertices(raw.vertices, raw.faces)
    _require_size(raw.name, largest_side(vertices), unit_m)

    problems = [f"ignored {raw.ignored} parts without faces (points or lines)"] if raw.ignored else []
    vertices, faces = merge_vertices(vertices * unit_m, faces)
    collapsed = _has_repeated_corner(faces)
    faces, repeated, backs = unique_faces(faces[~collapsed] if collapsed.any() else faces)
    if len(faces) == 0:
        raise _zero_area(raw.name)
    # Slivers are dropped after the bodies are found: without them a closed surface would have a slit.
    bodies = find_bodies(vertices, faces)
    faces, two_sided, winding_problems = _orient(raw.name, faces, bodies, fix_winding)
    has_area = nonzero_area(vertices, bodies.face_areas_m2)
    if not has_area.all():
        vertices, faces = used_vertices(vertices, faces[has_area])
    if len(faces) == 0:
        raise _zero_area(raw.name)

    if dropped := int(collapsed.sum() + (~has_area).sum()):
        problems.append(f"dropped {dropped} zero-area faces")
    if repeated:
        problems.append(f"dropped {repeated} duplicate faces")
    if backs:
        problems.append(f"dropped {backs} faces that were the back of another (a two-sided sheet)")
    return SurfaceMesh(vertices, faces, raw.name, two_sided, (*problems, *winding_problems))


def _require_triangles(raw: RawTriangles) -> None:
    if len(raw.faces) == 0:
        if len(raw.vertices) or raw.ignored:
            raise MeshError(
                "mesh.no_faces",
                f"{raw.name}: points or lines but no faces (a point cloud?); give a mesh with triangles",
            )
        raise MeshError("mesh.empty", f"{raw.name}: holds no geometry; get or export the file again")
    bad = int((~np.isfinite(raw.vertices)).any(axis=1).sum())
    if bad:
        raise MeshError(
            "mesh.nonfinite",
            f"{raw.name}: {bad} of {len(raw.vertices)} vertices are not finite (NaN or infinity); "
            "repair or re-export it",
        )


def _require_size(name: str, side: float, unit_m: float) -> None:
    if side == 0:
        raise _zero_area(name)
    side_m = side * unit_m
    if MIN_SIDE_M <= side_m <= MAX_SIDE_M:
        return
    fitting = [unit for unit, metres in _UNITS.items() if MIN_SIDE_M <= side * metres <= MAX_SIDE_M]
    if fitting:
        unit = min(fitting, key=lambda unit: abs(np.log(side * _UNITS[unit] / _USUAL_SIDE_M)))
        remedy = f"is it in {unit}? load with unit_m={_UNITS[unit]:g} (--unit {unit})"
    else:
        remedy = f"scale it to between {MIN_SIDE_M:g} and {MAX_SIDE_M:g} m with unit_m (--unit)"
    code, bound = ("large", "more") if side_m > MAX_SIDE_M else ("small", "less")
    limit_m = MAX_SIDE_M if side_m > MAX_SIDE_M else MIN_SIDE_M
    raise MeshError(
        f"mesh.too_{code}", f"{name}: largest side {side_m:.6g} m is {bound} than {limit_m:g} m: {remedy}"
    )


def _orient(
    name: str, faces: NDArray[np.int64], bodies: Bodies, fix_winding: bool
) -> tuple[NDArray[np.int64], bool, list[str]]:
    """Faces with outward winding where that is known, whether both sides reflect, and what was odd."""
    inverted = bodies.volume_m3 < 0
    num_bodies, num_inverted = len(inverted), int(inverted.sum())
    problems = []
    if bodies.inconsistent_edges:
        problems.append(
            f"{bodies.inconsistent_edges} edges join faces wound against each other: both sides reflect"
        )
    if num_inverted and fix_winding:
        faces = np.where(inverted[bodies.label][:, None], faces[:, ::-1], faces)
        problems.append(f"flipped {num_inverted} of {num_bodies} bodies that were turned inside out")
    elif num_inverted == num_bodies:
        raise MeshError(
            "mesh.inverted",
            f"{name}: turned inside out (negative volume, its normals point inwards); "
            "load with fix_winding=True (--fix-winding)",
        )
    elif num_inverted:
        problems.append(
            f"{num_inverted} of {num_bodies} bodies are turned inside out (or cavities): both sides reflect; "
            "fix_winding=True (--fix-winding) flips them"
        )
    has_volume = bodies.volume_m3 > 0
    return faces, not bool((has_volume | (inverted & fix_winding)).all()), problems


def _has_repeated_corner(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    a, b, c = faces.T
    return np.asarray((a == b) | (b == c) | (c == a))


def _zero_area(name: str) -> MeshError:
    return MeshError(
        "mesh.zero_area",
        f"{name}: every face has zero area (all corners on one point or line); get or export the file again",
    )
