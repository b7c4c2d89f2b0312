"""Vectorised repairs of a triangle soup: merged vertices, dropped faces, and its connected bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Vertices closer than this fraction of the largest side are one vertex (float32 resolves 6e-8 of it). Not a
# round number: the coordinates of a subdivided mesh would sit on the border between two cells.
_MERGE_FRACTION = 1.1547e-8
# A face with less than this fraction of the largest side squared has no area.
_ZERO_AREA_FRACTION = 1e-14
# A closed body has a volume if it exceeds this fraction of its area^1.5; less is rounding of a folded sheet.
_ZERO_VOLUME_FRACTION = 1e-7
_HASH_MULTIPLIERS = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)


@dataclass(frozen=True, eq=False)
class Bodies:
    """Parts of a mesh that are connected through edges.

    Attributes:
        label: (F,) integers, the body of every face.
        closed: (B,) bool, no border and all faces wound alike.
        volume_m3: (B,) signed volume of the closed ones, 0 where open or flat.
        face_areas_m2: (F,) area of every face.
        inconsistent_edges: edges whose two faces are wound against each other.
    """

    label: NDArray[np.integer]
    closed: NDArray[np.bool_]
    volume_m3: NDArray[np.float64]
    face_areas_m2: NDArray[np.float64]
    inconsistent_edges: int


def used_vertices(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The vertices that a face uses, in their order, and the faces renumbered."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces.ravel()] = True
    if used.all():
        return vertices, faces
    return vertices[used], (np.cumsum(used) - 1)[faces]


def merge_vertices(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Coincident vertices merged into the first of them; the order stays.

    Args:
        vertices: (V, 3) finite, not all equal.
        faces: (F, 3) indices.
    """
    cell = _MERGE_FRACTION * largest_side(vertices)
    columns = [np.round((column - column.min()) / cell).astype(np.int64) for column in vertices.T]
    representative, group = _group_rows(columns)
    if len(representative) == len(vertices):
        return vertices, faces
    return vertices[representative], group[faces]


def unique_faces(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], int, int]:
    """Faces without repetition.

    Returns:
        The first of every set of faces with the same corners, the number of dropped faces that were wound
        like the kept one, and of those that were wound against it (the back of a two-sided sheet).
    """
    a, b, c = faces.T
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    representative, group = _group_rows([low, a + b + c - low - high, high])
    if len(representative) == len(faces):
        return faces, 0, 0
    dropped = np.ones(len(faces), dtype=bool)
    dropped[representative] = False
    opposite = _is_odd(faces[dropped]) != _is_odd(faces[representative[group[dropped]]])
    return faces[representative], int((~opposite).sum()), int(opposite.sum())


def area_vectors(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F, 3) vectors along the right-hand normal of (F, 3, 3) triangles, of length their area."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2


def nonzero_area(vertices: NDArray[np.float64], areas_m2: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(F,) bool, the faces whose area is more than rounding."""
    return np.asarray(areas_m2 > _ZERO_AREA_FRACTION * largest_side(vertices) ** 2)


def largest_side(vertices: NDArray[np.float64]) -> float:
    """Largest side of the bounding box; infinite if it exceeds the number range."""
    with np.errstate(over="ignore"):
        return max(float(np.ptp(column)) for column in vertices.T)


def find_bodies(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Bodies:
    """Connected bodies, which of them are closed, and their signed volume.

    A body is closed if every edge is passed as often in one direction as in the other. That is the condition
    under which the divergence theorem gives its volume, and it also holds where two bodies touch in an edge.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end = faces.T.ravel(), faces[:, [1, 2, 0]].T.ravel()
    edge = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    order = np.argsort(edge)
    edge = edge[order]
    same = edge[1:] == edge[:-1]
    face = order % len(faces)
    pairs = (face[:-1][same], face[1:][same])
    graph = coo_array((np.ones(len(pairs[0]), dtype=bool), pairs), shape=(len(faces), len(faces)))
    num_bodies, label = connected_components(graph, directed=False)

    first = np.flatnonzero(np.concatenate([[True], ~same]))
    balance = np.add.reduceat(np.where(start < end, 1, -1)[order], first)
    uses = np.diff(np.append(first, len(edge)))
    closed = np.ones(num_bodies, dtype=bool)
    closed[label[face[first[balance != 0]]]] = False

    # Relative to one of its own points: far from the origin the volume is a difference of large numbers.
    triangles = (vertices - vertices[faces[0, 0]])[faces]
    vectors = area_vectors(triangles)
    face_areas_m2 = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    face_volumes_m3 = np.einsum("ij,ij->i", triangles[:, 0], vectors) / 3
    volume_m3 = np.asarray(np.bincount(label, face_volumes_m3, num_bodies), dtype=np.float64)
    flat_m3 = _ZERO_VOLUME_FRACTION * np.bincount(label, face_areas_m2, num_bodies) ** 1.5
    volume_m3[~closed | (np.abs(volume_m3) <= flat_m3)] = 0.0
    inconsistent = int(((balance != 0) & (uses % 2 == 0)).sum())
    return Bodies(label, closed, volume_m3, face_areas_m2, inconsistent)


def _group_rows(columns: list[NDArray[np.int64]]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First index of every distinct row in order of appearance, and the number of its group for every row.

    Rows are sorted by a 64-bit hash, far faster than by their columns. Groups are told apart by the rows
    themselves, so that a collision could at worst leave two equal rows apart, never join different ones.
    """
    key = sum(
        column.astype(np.uint64) * np.uint64(multiplier)
        for column, multiplier in zip(columns, _HASH_MULTIPLIERS, strict=True)
    )
    keys = np.sort(np.asarray(key))
    if not (keys[1:] == keys[:-1]).any():
        return np.arange(len(keys)), np.arange(len(keys))
    order = np.argsort(np.asarray(key), kind="stable")
    is_new = np.zeros(len(keys), dtype=bool)
    is_new[0] = True
    for column in columns:
        is_new[1:] |= column[order[1:]] != column[order[:-1]]
    first = order[is_new]
    by_appearance = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[by_appearance] = np.arange(len(first))
    group = np.empty(len(keys), dtype=np.int64)
    group[order] = rank[np.cumsum(is_new) - 1]
    return first[by_appearance], group


def _is_odd(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(F,) bool, the corners are an odd permutation of their sorted order."""
    a, b, c = faces.T
    return np.asarray((a > b) ^ (b > c) ^ (a > c))
