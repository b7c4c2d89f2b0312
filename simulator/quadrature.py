"""Sample points of a surface: one for every piece of its tessellation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.tessellation import LARGEST_AREA_FRACTION, tessellate

# Samples worked on at a time: about 0.5 GB with everything that hangs on them.
CHUNK_SAMPLES = 1_000_000


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
    """One sample for every piece of the tessellated surface.

    The division happens in the mesh frame and therefore does not depend on the pose.

    Args:
        mesh: the surface.
        pose: (4, 4) rigid transform applied to the samples.
        spacing_m: largest edge of a piece.
        keep: (F,) bool, the faces to sample; None for all.

    Raises:
        MeshError: ``mesh.spacing`` or ``mesh.too_many_samples``.
    """
    pieces = tessellate(mesh, spacing_m, keep)
    rotation = np.asarray(pose, dtype=np.float64)[:3, :3]
    # Not the matrix product: its last bits depend on how many threads BLAS uses.
    corners = np.einsum("fkj,ij->fki", mesh.triangles_m, rotation) + np.asarray(pose, dtype=np.float64)[:3, 3]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    # take gathers rows several times faster than indexing with brackets
    points_m = corners[:, 0].take(pieces.face, axis=0)
    points_m += pieces.barycentric[:, :1] * u.take(pieces.face, axis=0)
    points_m += pieces.barycentric[:, 1:] * v.take(pieces.face, axis=0)
    return SurfaceSamples(
        points_m=points_m,
        normals=np.einsum("fj,ij->fi", mesh.normals, rotation).take(pieces.face, axis=0),
        areas_m2=mesh.areas_m2.take(pieces.face) / pieces.divisor,
        spread_m2=np.einsum("sk,sk->s", pieces.spread_form, _edge_products(mesh).take(pieces.face, axis=0)),
    )


def _edge_products(mesh: SurfaceMesh) -> NDArray[np.float64]:
    """u.u, u.v and v.v of the edges u, v of every face from its corner 0, (F, 3): no pose changes them."""
    u, v = (mesh.triangles_m[:, corner] - mesh.triangles_m[:, 0] for corner in (1, 2))
    return np.stack([np.einsum("fi,fi->f", a, b) for a, b in ((u, u), (u, v), (v, v))], axis=1)


def face_chunks(mesh: SurfaceMesh, keep: NDArray[np.bool_], spacing_m: float) -> list[NDArray[np.bool_]]:
    """Cut the kept faces (F,) into runs of about `CHUNK_SAMPLES` samples each, so that memory stays bounded.

    Returns:
        Masks (F,) of which `keep` is the disjoint union; one mask for most objects.
    """
    # well-shaped pieces fill about 0.7 of the largest triangle with such edges
    expected = mesh.areas_m2 / (0.7 * LARGEST_AREA_FRACTION * spacing_m**2) + 1.0
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
