"""Sample points of a surface: every triangle cut into small similar triangles, one sample per piece."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh

MAX_SAMPLES = 50_000_000
# Samples worked on at a time: about 0.5 GB with everything that hangs on them.
CHUNK_SAMPLES = 1_000_000
# A triangle flatter than this (height over longest edge; 0.87 when equilateral) is a needle.
_NEEDLE_RATIO = 0.35
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
    """Cuts every face into m^2 similar triangles with edges up to the spacing; one sample per piece.

    Similar pieces form one lattice of the smallest period that their number allows, so that a phase crossing
    them obliquely does not alias before two samples a wavelength; bisection leaves a coarser period and was
    4 times worse on a sphere. Needles are bisected across first, since m^2 pieces would waste them.
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
    if len(faces) == 0:
        return SurfaceSamples(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0))
    needles = _cut_needles(mesh, faces, spacing_m)
    face, centroids, divisor, spread = _divide(needles, spacing_m)
    rotation = np.asarray(pose, dtype=np.float64)[:3, :3]
    # Not the matrix product: its last bits depend on how many threads BLAS uses.
    points_m = np.einsum("sj,ij->si", centroids, rotation)
    points_m += np.asarray(pose, dtype=np.float64)[:3, 3]
    normals = np.einsum("fj,ij->fi", mesh.normals, rotation)
    return SurfaceSamples(
        points_m=points_m,
        # take gathers rows several times faster than indexing with brackets.
        normals=normals.take(face, axis=0),
        areas_m2=mesh.areas_m2.take(face) / divisor,
        spread_m2=spread,
    )


def face_chunks(mesh: SurfaceMesh, keep: NDArray[np.bool_], spacing_m: float) -> list[NDArray[np.bool_]]:
    """Cut the kept faces (F,) into runs of about `CHUNK_SAMPLES` samples each, so that memory stays bounded.

    Returns:
        Masks (F,) of which `keep` is the disjoint union; one mask for most objects.
    """
    # well-shaped pieces fill about 0.7 of the largest triangle with such edges
    expected = mesh.areas_m2 / (0.7 * _LARGEST_AREA_FRACTION * spacing_m**2) + 1.0
    chunk = (np.cumsum(np.where(keep, expected, 0.0)) / CHUNK_SAMPLES).astype(np.int64)
    return [keep & (chunk == index) for index in np.unique(chunk[keep])]


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
    """Triangles to divide: face and number of bisections (n,), corners (n, 3, 3), squared edges (n, 3).

    ``squares[:, i]`` is the squared length of the edge opposite corner i.
    """

    face: NDArray[np.int64]
    depth: NDArray[np.int64]
    corners: NDArray[np.float64]
    squares: NDArray[np.float64]

    def __getitem__(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> _Triangles:
        return _Triangles(self.face[chosen], self.depth[chosen], self.corners[chosen], self.squares[chosen])

    @classmethod
    def concatenate(cls, parts: list[_Triangles]) -> _Triangles:
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


def _cut_needles(mesh: SurfaceMesh, faces: NDArray[np.int64], spacing_m: float) -> _Triangles:
    """The faces, long needles bisected at their longest edge until they are short or no needles."""
    corners = mesh.triangles_m[faces]
    edges = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    squares = np.einsum("fij,fij->fi", edges, edges)
    by_area = mesh.areas_m2[faces] / (_LARGEST_AREA_FRACTION * spacing_m**2)
    by_length = np.sqrt(squares.max(axis=1, initial=0.0)) / spacing_m
    _refuse_excess(float(np.maximum(by_area, by_length).sum()), spacing_m)
    rest = _Triangles(faces, np.zeros(len(faces), dtype=np.int64), corners, squares)
    finished = []
    while len(rest.face):
        # Heron: 16 area^2 from the squared edges
        total = rest.squares.sum(axis=1)
        sixteen_area_squared = total**2 - 2.0 * (rest.squares**2).sum(axis=1)
        longest = rest.squares.max(axis=1)
        needle = (longest > spacing_m**2) & (sixteen_area_squared < 4.0 * (_NEEDLE_RATIO * longest) ** 2)
        finished.append(rest[~needle])
        rest = _halve(rest[needle])
    return _Triangles.concatenate(finished)


def _halve(triangles: _Triangles) -> _Triangles:
    """Both halves of every triangle, cut from the middle of its longest edge to the corner opposite."""
    row = np.arange(len(triangles.face))
    apex = triangles.squares.argmax(axis=1)
    left, right = (apex + 1) % 3, (apex + 2) % 3
    top, start, end = (triangles.corners[row, corner] for corner in (apex, left, right))
    longest, to_end, to_start = (triangles.squares[row, corner] for corner in (apex, left, right))
    middle = (start + end) / 2
    # the median to the longest edge c of a triangle: (a^2 + b^2) / 2 - c^2 / 4
    median = (to_end + to_start) / 2 - longest / 4
    return _Triangles.concatenate(
        [
            _Triangles(
                triangles.face,
                triangles.depth + 1,
                np.stack([top, outer, middle], axis=1),
                np.stack([longest / 4, median, leg], axis=1),
            )
            for outer, leg in ((start, to_start), (end, to_end))
        ]
    )


def _divide(
    triangles: _Triangles, spacing_m: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Face, centroid, face area over piece area, and spread of every piece, sorted by face."""
    longest = np.sqrt(triangles.squares.max(axis=1, initial=0.0))
    per_edge = np.maximum(1, np.ceil(longest / spacing_m * (1 - 1e-12))).astype(np.int64)
    _refuse_excess(float((per_edge.astype(np.float64) ** 2).sum()), spacing_m)
    parts = []
    for count in np.unique(per_edge):
        group = triangles[per_edge == count]
        steps = _lattice_centroids(int(count))  # (count^2, 2)
        first = (group.corners[:, 1] - group.corners[:, 0])[:, None]
        second = (group.corners[:, 2] - group.corners[:, 0])[:, None]
        centroid = group.corners[:, :1] + steps[:, :1] * first + steps[:, 1:] * second
        # a triangle's half trace of covariance is the sum of its squared edges / 72
        spread = group.squares.sum(axis=1) / 72 / count**2
        pieces = len(steps)
        parts.append(
            (
                np.repeat(group.face, pieces),
                centroid.reshape(-1, 3),
                np.repeat(np.ldexp(float(count) ** 2, group.depth), pieces),
                np.repeat(spread, pieces),
            )
        )
    face, centroids, divisor, spreads = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(face, kind="stable")
    return face[order], centroids.take(order, axis=0), divisor[order], spreads[order]


def _lattice_centroids(count: int) -> NDArray[np.float64]:
    """Centroids of the count^2 similar pieces of a triangle, in units of its two edges from corner 0."""
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    upright, inverted = i + j <= count - 1, i + j <= count - 2
    steps = [
        np.stack([i[keep] + third, j[keep] + third], axis=1)
        for keep, third in ((upright, 1 / 3), (inverted, 2 / 3))
    ]
    return np.concatenate(steps) / count


def _refuse_excess(count: float, spacing_m: float) -> None:
    """Raises before any piece is made if there would be more than ``MAX_SAMPLES``."""
    if count > MAX_SAMPLES:
        raise MeshError(
            "mesh.too_many_samples",
            f"sampling this surface every {spacing_m:.3g} m needs {count:.2g} points or more, above the "
            f"limit of {MAX_SAMPLES:.0e}: use a larger spacing, a smaller mesh, or check its unit "
            "(unit_m, --unit)",
        )
