"""Pieces in coordinates of their faces: they follow the vertices, whatever moves these."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.quadrature import sample_surface
from waveformer.simulator.reference_frozen import samples_of
from waveformer.simulator.tessellation import tessellate

SPACING_M = 0.0013


def surface() -> SurfaceMesh:
    """Faces of many shapes, needles among them."""
    mesh = primitives.sphere(0.01, 0.004)
    vertices = np.array(mesh.vertices) * [1.0, 0.6, 0.15] + [0.0, 0.0, -0.3]
    # no two edges of equal length, so that rounding decides nothing
    vertices += np.random.default_rng(1).normal(size=vertices.shape) * 1e-4
    return SurfaceMesh(vertices, np.array(mesh.faces), "ellipsoid", False)


def deformed(mesh: SurfaceMesh) -> SurfaceMesh:
    vertices = mesh.vertices_m + 0.002 * np.sin(300 * mesh.vertices_m[:, [1, 2, 0]])
    return SurfaceMesh(vertices, mesh.faces, "deformed", False)


def test_pieces_that_follow_a_turned_mesh_are_its_samples() -> None:
    mesh, pieces = surface(), tessellate(surface(), SPACING_M)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = SurfaceMesh(mesh.vertices_m @ turn.T + [0.01, 0.02, 0.03], mesh.faces, "moved", False)
    direct, followed = (
        sample_surface(moved, np.eye(4), SPACING_M),
        samples_of(pieces, mesh.faces, moved.vertices_m),
    )
    for name in ("points_m", "normals", "areas_m2", "spread_m2"):
        one, other = getattr(direct, name), getattr(followed, name)
        assert one == pytest.approx(other, rel=1e-9, abs=1e-14), name  # float64, of numbers down to 1e-9


def test_area_and_first_two_moments_of_every_face_stay_exact_when_it_is_deformed() -> None:
    mesh = surface()
    pieces, moved = tessellate(mesh, SPACING_M), deformed(mesh)
    samples = samples_of(pieces, mesh.faces, moved.vertices_m)
    count, corners = len(mesh.faces), moved.triangles_m
    center = corners.mean(axis=1)
    area = np.bincount(pieces.face, samples.areas_m2, count)
    assert area == pytest.approx(moved.areas_m2, rel=1e-12)
    first = [np.bincount(pieces.face, samples.areas_m2 * x, count) / area for x in samples.points_m.T]
    assert np.stack(first, axis=1) == pytest.approx(center, abs=1e-14)
    # half the trace of the second moment of a triangle: sum |v_i - c|^2 / 24
    whole = ((corners - center[:, None]) ** 2).sum(axis=(1, 2)) / 24
    apart = 0.5 * ((samples.points_m - center[pieces.face]) ** 2).sum(axis=1) + samples.spread_m2
    assert np.bincount(pieces.face, samples.areas_m2 * apart, count) / area == pytest.approx(whole, rel=1e-9)
    assert samples.normals == pytest.approx(moved.normals[pieces.face], abs=1e-12)


def test_the_spread_of_a_whole_face_in_its_edges() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.0003, 0.0008, 0.0]])
    pieces = tessellate(SurfaceMesh(corners, np.array([[0, 1, 2]]), "triangle", True), 0.01)
    assert (len(pieces), pieces.divisor.tolist()) == (1, [1.0])
    assert pieces.barycentric == pytest.approx(np.full((1, 2), 1 / 3))
    # sum of the squared edges / 72 with the edges u, v and v - u
    assert pieces.spread_form == pytest.approx(np.array([[2.0, -2.0, 2.0]]) / 72)


def test_only_faces_that_are_kept_are_cut() -> None:
    mesh, whole = surface(), tessellate(surface(), SPACING_M)
    keep = np.arange(len(mesh.faces)) % 3 == 0
    some = tessellate(mesh, SPACING_M, keep)
    expected = whole.take(np.flatnonzero(keep[whole.face]))
    for name in ("face", "barycentric", "divisor", "spread_form"):
        assert (getattr(some, name) == getattr(expected, name)).all(), name
    assert len(tessellate(mesh, SPACING_M, np.zeros(len(keep), dtype=bool))) == 0


@pytest.mark.parametrize("spacing_m", [0.0, -1.0, np.nan])
def test_a_spacing_must_be_positive(spacing_m: float) -> None:
    with pytest.raises(MeshError, match="spacing_m must be a positive number"):
        tessellate(surface(), spacing_m)


def test_too_many_pieces_are_refused() -> None:
    with pytest.raises(MeshError, match="use a larger spacing"):
        tessellate(surface(), 1e-8)
