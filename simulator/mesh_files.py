"""Mesh files and trimesh objects as plain arrays, or one line that says why not."""

from __future__ import annotations

import contextlib
import io
import os
import stat
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh_formats import (
    GET_AGAIN,
    check_before,
    index_range,
    one_line,
    plain_reason,
    promised_faces,
    sniff_format,
    truncated,
)

MAX_FILE_BYTES = 2_000_000_000


@dataclass(frozen=True, eq=False)
class RawTriangles:
    """Triangles as they came, not yet checked.

    Attributes:
        name: of the file or object, for messages.
        vertices: (V, 3) float64, in the unit of the source.
        faces: (F, 3) int64, may be empty or point outside ``vertices``.
        ignored: number of scene parts without triangles (points, lines).
    """

    name: str
    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    ignored: int


def read_triangles(source: Any) -> RawTriangles:
    """The triangles of a mesh file, trimesh.Trimesh or trimesh.Scene, all scene nodes placed.

    Raises:
        MeshError: the file is missing, unreadable, truncated, an archive or too big, or the source is of
            another type.
    """
    import trimesh

    if isinstance(source, (str, os.PathLike)):
        return _read_file(Path(os.fsdecode(source)))
    name = one_line(getattr(source, "metadata", {}).get("name") or "mesh")
    if isinstance(source, trimesh.Scene):
        return _scene_triangles(name, source)
    if isinstance(source, trimesh.Trimesh):
        return _join(name, [(source.vertices, source.faces)], ignored=0)
    if isinstance(source, trimesh.PointCloud):
        return _join(name, [], ignored=1)
    raise MeshError(
        "mesh.unreadable",
        f"a mesh must be a file path, trimesh.Trimesh or trimesh.Scene, got {type(source).__name__}",
    )


def _read_file(path: Path) -> RawTriangles:
    name = one_line(path.name or str(path))
    try:
        status = os.stat(path)
    except (OSError, ValueError) as error:
        raise MeshError("mesh.missing", f"{one_line(path)}: no such mesh file; check the path") from error
    if not stat.S_ISREG(status.st_mode):
        raise MeshError("mesh.unreadable", f"{name}: not a regular file; name one mesh file")
    size_bytes = status.st_size
    if size_bytes > MAX_FILE_BYTES:
        raise MeshError(
            "mesh.too_big_file",
            f"{name}: {size_bytes / 1e9:.1f} GB is more than the limit of {MAX_FILE_BYTES / 1e9:g} GB; "
            "simplify the mesh",
        )
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(
            "mesh.unreadable", f"{name}: cannot be read ({error.strerror}); check its permissions"
        ) from error
    file_format = sniff_format(name, path.suffix.lower().lstrip("."), data)
    check_before(file_format, name, data)
    raw = _parse(path, name, file_format, data)
    promised = promised_faces(file_format, data)
    if len(raw.faces) < promised:
        raise truncated(name, f"only {len(raw.faces)} of {promised} faces are there")
    return raw


def _parse(path: Path, name: str, file_format: str, data: bytes) -> RawTriangles:
    import trimesh

    try:
        with _quiet():
            if file_format == "stl":
                # Read without a Scene: trimesh would drop non-finite corners of a text STL of several solids.
                solids = trimesh.exchange.stl.load_stl(io.BytesIO(data))
                parts = solids["geometry"].values() if "geometry" in solids else [solids]
                return _join(name, [(part["vertices"], part["faces"]) for part in parts], ignored=0)
            scene = trimesh.load_scene(
                io.BytesIO(data),
                file_type=file_format,
                resolver=trimesh.resolvers.FilePathResolver(str(path)),
                process=False,
                skip_materials=True,
            )
            return _scene_triangles(name, scene)
    except MeshError:
        raise
    except (RecursionError, MemoryError) as error:
        raise MeshError(
            "mesh.unreadable", f"{name}: too large or too deeply nested to read; simplify it"
        ) from error
    except Exception as error:  # trimesh raises whatever the broken bytes lead to
        reason = plain_reason(error)
        if (file_format == "obj" and isinstance(error, IndexError)) or "face index" in reason:
            raise index_range(name, "a face names a vertex that is not there") from error
        if file_format == "ply" and "unexpected length" in reason:
            reason = (
                "its length is not what its header promises; cut off, or polygons of different corner counts"
            )
            raise MeshError("mesh.truncated", f"{name}: {reason}; {GET_AGAIN}, triangulated") from error
        is_cut = isinstance(error, (AssertionError, IndexError))
        if isinstance(error, NotImplementedError) or (file_format == "gltf" and not is_cut):
            raise MeshError("mesh.unreadable", f"{name}: cannot be read ({reason}); {GET_AGAIN}") from error
        raise truncated(name, reason) from error


def _scene_triangles(name: str, scene: Any) -> RawTriangles:
    import trimesh

    parts, ignored = [], 0
    for node in scene.graph.nodes_geometry:
        transform, geometry_name = scene.graph[node]
        geometry = scene.geometry[geometry_name]
        if not isinstance(geometry, trimesh.Trimesh):
            ignored += 1
            continue
        vertices = np.asarray(geometry.vertices, dtype=np.float64) @ transform[:3, :3].T + transform[:3, 3]
        mirrored = np.linalg.det(transform[:3, :3]) < 0
        parts.append((vertices, geometry.faces[:, ::-1] if mirrored else geometry.faces))
    return _join(name, parts, ignored)


def _join(name: str, parts: list[tuple[Any, Any]], ignored: int) -> RawTriangles:
    vertices, faces, offset = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for part_vertices, part_faces in parts:
        points = np.asarray(part_vertices, dtype=np.float64).reshape(-1, 3)
        corners = np.asarray(part_faces, dtype=np.int64).reshape(-1, 3)
        # Checked per part: the offset of the next part would hide an index that is out of range here.
        bad = corners[(corners < 0) | (corners >= len(points))]
        if len(bad):
            raise index_range(name, f"a face names vertex {bad[0]} of {len(points)}")
        vertices.append(points)
        faces.append(corners + offset)
        offset += len(points)
    return RawTriangles(name, np.concatenate(vertices), np.concatenate(faces), ignored)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """No log lines of trimesh, and numpy's warning about unreadable numbers as the error it is."""
    import trimesh

    log = trimesh.util.log
    before = log.disabled
    log.disabled = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", message="string or file could not be read to its end")
            yield
    finally:
        log.disabled = before
