"""Triangles cut into small similar pieces, in coordinates of their face: what stays while the vertices move."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh

MAX_SAMPLES = 50_000_000
# A triangle flatter than this (height over longest edge; 0.87 when equilateral) is a needle.
_NEEDLE_RATIO = 0.35
# No triangle with edges up to s is larger than the equilateral one.
LARGEST_AREA_FRACTION = np.sqrt(3.0) / 4


@dataclass(frozen=True, eq=False)
class Tessellation:
    """The pieces of a surface, pieces of a face next to each other and faces in mesh order.

    With u and v the edges of a face from corner 0 to corners 1 and 2, a piece has its centroid at
    corner 0 + b_0 u + b_1 v and the mean in-plane variance q_0 u.u + q_1 u.v + q_2 v.v.

    Attributes:
        face: (S,) face of every piece.
        barycentric: (S, 2) b.
        divisor: (S,) area of the face over that of the piece.
        spread_form: (S, 3) q.
    """

    face: NDArray[np.int64]
    barycentric: NDArray[np.float64]
    divisor: NDArray[np.float64]
    spread_form: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.face)

    def take(self, index: NDArray[np.int64]) -> Tessellation:
        """The pieces at `index`, in that order."""
        return Tessellation(*(getattr(self, field.name).take(index, axis=0) for field in fields(self)))


def tessellate(mesh: SurfaceMesh, spacing_m: float, keep: NDArray[np.bool_] | None = None) -> Tessellation:
    """Cuts every face into m^2 similar triangles with edges up to the spacing.

    Similar pieces form one lattice of the smallest period that their number allows, so that a phase crossing
    them obliquely does not alias before two samples a wavelength; bisection leaves a coarser period and was
    4 times worse on a sphere. Needles are bisected across first, since m^2 pieces would waste them.
    Neighbouring faces are divided independently: for an integral the pieces need not fit together.

    Args:
        mesh: the surface.
        spacing_m: largest edge of a piece.
        keep: (F,) bool, the faces to cut; None for all.

    Raises:
        MeshError: ``mesh.spacing`` or ``mesh.too_many_samples``.
    """
    if not (np.isfinite(spacing_m) and spacing_m > 0):
        raise MeshError("mesh.spacing", f"spacing_m must be a positive number of metres, got {spacing_m!r}")
    faces = np.arange(len(mesh.faces)) if keep is None else np.flatnonzero(keep)
    if len(faces) == 0:
        return Tessellation(faces, np.empty((0, 2)), np.empty(0), np.empty((0, 3)))
    return _divide(_cut_needles(mesh, faces, spacing_m), spacing_m)


@dataclass(frozen=True, eq=False)
class _Triangles:
    """Triangles to divide.

    Attributes:
        face, depth: face and number of bisections (n,).
        corners: in coordinates of the face (n, 3, 2).
        squares: squared length of the edge opposite every corner (n, 3).
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
    by_area = mesh.areas_m2[faces] / (LARGEST_AREA_FRACTION * spacing_m**2)
    by_length = np.sqrt(squares.max(axis=1, initial=0.0)) / spacing_m
    _refuse_excess(float(np.maximum(by_area, by_length).sum()), spacing_m)
    whole = np.broadcast_to([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], (len(faces), 3, 2))
    rest = _Triangles(faces, np.zeros(len(faces), dtype=np.int64), whole, squares)
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


def _divide(triangles: _Triangles, spacing_m: float) -> Tessellation:
    """The pieces of all triangles, sorted by face."""
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
        edges = group.corners[:, [2, 0, 1]] - group.corners[:, [1, 2, 0]]
        u, v = edges[..., 0], edges[..., 1]
        form = np.stack([(u * u).sum(axis=1), 2.0 * (u * v).sum(axis=1), (v * v).sum(axis=1)], axis=1)
        pieces = len(steps)
        parts.append(
            (
                np.repeat(group.face, pieces),
                centroid.reshape(-1, 2),
                np.repeat(np.ldexp(float(count) ** 2, group.depth), pieces),
                np.repeat(form / 72 / count**2, pieces, axis=0),
            )
        )
    pieces_of_all = Tessellation(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    return pieces_of_all.take(np.argsort(pieces_of_all.face, kind="stable"))


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
