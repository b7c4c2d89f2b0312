"""Sample points of a surface: every triangle bisected until it is small, one sample per piece."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh

MAX_SAMPLES = 50_000_000
# Triangles bisected at a time: their arrays fit the second-level cache.
_BLOCK = 8192
# No triangle with edges up to s is larger than the equilateral one.
_LARGEST_AREA_FRACTION = np.sqrt(3.0) / 4


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Quadrature points of a surface, pieces of a face next to each other and faces in mesh order.

    Attributes:
        points_m: (S, 3) centroids of the pieces.
        normals: (S, 3) unit normals of their faces.
        areas_m2: (S,) areas, which sum to the area of the mesh.
        spread_m2: (S,) mean variance of a piece's points along its two in-plane axes: half the trace of the
            covariance, which for a triangle is sum (v_i - c)(v_i - c)^T / 12 over its corners.
    """

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    areas_m2: NDArray[np.float64]
    spread_m2: NDArray[np.float64]


def take(samples: SurfaceSamples, index: NDArray[np.int64]) -> SurfaceSamples:
    """The samples at `index`, in that order."""
    return SurfaceSamples(
        samples.points_m[index], samples.normals[index], samples.areas_m2[index], samples.spread_m2[index]
    )


def sample_surface(
    mesh: SurfaceMesh,
    pose: NDArray[np.float64],
    spacing_m: float,
    keep: NDArray[np.bool_] | None = None,
) -> SurfaceSamples:
    """Bisects every face at its longest edge until no edge exceeds the spacing; one sample per piece.

    Neighbouring faces are divided independently: for an integral the pieces need not fit together. The
    division happens in the mesh frame and therefore does not depend on the pose.

    Args:
        mesh: the surface.
        pose: (4, 4) rigid transform applied to the samples.
        spacing_m: largest edge of a piece.
        keep: (F,) bool, the faces to sample; None for all.

    Raises:
        MeshError: ``mesh.spacing`` or ``mesh.too_many_samples``.
    """
    if not (np.isfinite(spacing_m) and spacing_m > 0):
        raise MeshError("mesh.spacing", f"spacing_m must be a positive number of metres, got {spacing_m!r}")
    faces = np.arange(len(mesh.faces)) if keep is None else np.flatnonzero(keep)
    pieces = _bisect(mesh, faces, spacing_m)
    pose = np.asarray(pose, dtype=np.float64)
    rotation = pose[:3, :3]
    # Not the matrix product: its last bits depend on how many threads BLAS uses.
    points_m = np.einsum("sj,ij->si", pieces.centroid, rotation)
    points_m += pose[:3, 3]
    normals = np.einsum("fj,ij->fi", mesh.normals, rotation)
    return SurfaceSamples(
        points_m=points_m,
        # take gathers rows several times faster than indexing with brackets.
        normals=normals.take(pieces.face, axis=0),
        areas_m2=np.ldexp(mesh.areas_m2.take(pieces.face), -pieces.depth),
        spread_m2=pieces.spread_m2,
    )


def faces_that_can_face(
    triangles_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    two_sided: bool,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Faces that some transmitter and some receiver may see from the front; never drops one that can echo.

    Args:
        triangles_m: (F, 3, 3) in the radar frame.
        normals: (F, 3) unit.
        two_sided: True if both sides of a face reflect; then all faces stay.
        tx_m: (N, 3) transmitters.
        rx_m: (N, 3) receivers.

    Returns:
        (F,) bool.
    """
    if two_sided:
        return np.ones(len(triangles_m), dtype=bool)
    offset = np.einsum("ij,ij->i", normals, triangles_m[:, 0])
    can_face = np.ones(len(triangles_m), dtype=bool)
    for antennas_m in (tx_m, rx_m):
        # A linear function has its maximum over the bounding box in a corner: per axis the larger product.
        reach = np.maximum(normals * antennas_m.min(axis=0), normals * antennas_m.max(axis=0)).sum(axis=1)
        can_face &= reach > offset - 1e-9  # a nanometre covers the rounding
    return can_face


@dataclass(frozen=True, eq=False)
class _Triangles:
    """Triangles to bisect: face and number of bisections (n,), corners (n, 3, 3), squared edges (n, 3).

    ``squares[:, i]`` is the squared length of the edge opposite corner i.
    """

    face: NDArray[np.int64]
    depth: NDArray[np.int8]
    corners: NDArray[np.float64]
    squares: NDArray[np.float64]

    def __getitem__(self, chosen: slice | NDArray[np.bool_]) -> _Triangles:
        return _Triangles(self.face[chosen], self.depth[chosen], self.corners[chosen], self.squares[chosen])


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Finished pieces: face, number of bisections and spread (n,), centroid (n, 3)."""

    face: NDArray[np.int64]
    depth: NDArray[np.int8]
    centroid: NDArray[np.float64]
    spread_m2: NDArray[np.float64]


def _bisect(mesh: SurfaceMesh, faces: NDArray[np.int64], spacing_m: float) -> _Pieces:
    """All pieces of the given faces, sorted by face.

    Depth first in blocks: unfinished triangles take little memory and stay in the processor's cache.
    """
    corners = mesh.triangles_m[faces]
    edges = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    squares = np.einsum("fij,fij->fi", edges, edges)
    _refuse_excess(mesh.areas_m2[faces], squares, spacing_m)

    limit = spacing_m**2
    fits = squares.max(axis=1, initial=0.0) <= limit
    whole = _Triangles(faces, np.zeros(len(faces), dtype=np.int8), corners, squares)
    small, large = whole[fits], whole[~fits]
    finished = [
        _Pieces(small.face, small.depth, small.corners.sum(axis=1) / 3, small.squares.sum(axis=1) / 72)
    ]
    stack = [large[first : first + _BLOCK] for first in range(0, len(large.face), _BLOCK)]
    while stack:
        pieces, rest = _halve(stack.pop(), limit)
        finished.extend(pieces)
        stack.extend(rest[first : first + _BLOCK] for first in range(0, len(rest.face), _BLOCK))
    face, depth, centroid, spread_m2 = (
        np.concatenate([getattr(pieces, field.name) for pieces in finished]) for field in fields(_Pieces)
    )
    order = np.argsort(face, kind="stable")
    return _Pieces(*(column.take(order, axis=0) for column in (face, depth, centroid, spread_m2)))


def _halve(block: _Triangles, limit: float) -> tuple[list[_Pieces], _Triangles]:
    """Bisects every triangle at its longest edge: the halves that fit, and those that are still too long.

    Squared edge lengths are carried along, since the median to the longest edge c of a triangle is
    (a^2 + b^2) / 2 - c^2 / 4; area and normal follow from the face, so only the midpoint is computed.
    """
    first = np.arange(0, 3 * len(block.face), 3)
    apex = block.squares.argmax(axis=1)
    left, right = (apex + 1) % 3, (apex + 2) % 3
    points, lengths = block.corners.reshape(-1, 3), block.squares.ravel()
    top, start, end = (points.take(first + corner, axis=0) for corner in (apex, left, right))
    longest, to_end, to_start = (lengths.take(first + corner) for corner in (apex, left, right))
    middle = (start + end) / 2
    median, quarter = (to_end + to_start) / 2 - longest / 4, longest / 4
    depth = block.depth + np.int8(1)

    finished, too_long = [], []
    for outer, leg in ((start, to_start), (end, to_end)):
        fits = np.maximum(np.maximum(median, leg), quarter) <= limit
        finished.append(
            _Pieces(
                block.face[fits],
                depth[fits],
                (top + outer + middle)[fits] / 3,
                (quarter + median + leg)[fits] / 72,
            )
        )
        large = ~fits
        too_long.append(
            _Triangles(
                block.face[large],
                depth[large],
                np.stack([top[large], outer[large], middle[large]], axis=1),
                np.stack([quarter[large], median[large], leg[large]], axis=1),
            )
        )
    return finished, _Triangles(
        *(np.concatenate([getattr(part, field.name) for part in too_long]) for field in fields(_Triangles))
    )


def _refuse_excess(areas_m2: NDArray[np.float64], squares: NDArray[np.float64], spacing_m: float) -> None:
    """Raises before any piece is made if there would be more than ``MAX_SAMPLES``."""
    by_area = areas_m2 / (_LARGEST_AREA_FRACTION * spacing_m**2)
    by_length = np.sqrt(squares.max(axis=1, initial=0.0)) / spacing_m
    count = float(np.ceil(np.maximum(by_area, by_length)).sum())
    # The true count is 2 to 4 times this lower bound, 20 times for needles.
    if MAX_SAMPLES / 25 < count <= MAX_SAMPLES:
        count = _count_pieces(squares, spacing_m**2)
    if count > MAX_SAMPLES:
        raise MeshError(
            "mesh.too_many_samples",
            f"sampling this surface every {spacing_m:.3g} m needs {count:.2g} points or more, above the "
            f"limit of {MAX_SAMPLES:.0e}: use a larger spacing, a smaller mesh, or check its unit "
            "(unit_m, --unit)",
        )


def _count_pieces(squares: NDArray[np.float64], limit: float) -> float:
    """Number of pieces, from the edge lengths alone.

    Repeated bisection at the longest edge makes only a few different shapes, so that merging the congruent
    ones of every pass keeps the count cheap even for millions of pieces.
    """
    copies = np.ones(len(squares))
    count = 0.0
    while len(squares):
        shapes = np.sort(squares, axis=1)
        _, first, group = np.unique(
            np.round(shapes / limit, 9), axis=0, return_index=True, return_inverse=True
        )
        copies, shapes = np.asarray(np.bincount(group.ravel(), copies), dtype=np.float64), shapes[first]
        fits = shapes[:, 2] <= limit
        count += float(copies[fits].sum())
        copies, (a, b, c) = copies[~fits], shapes[~fits].T
        median = (a + b) / 2 - c / 4
        squares = np.concatenate([np.stack([leg, median, c / 4], axis=1) for leg in (a, b)])
        copies = np.tile(copies, 2)
    return count
