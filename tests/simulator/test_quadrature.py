"""Surface samples: exact area, moments of the pieces, second-order convergence, and the cull of faces."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from waveformer.simulator import primitives, tessellation
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.quadrature import faces_that_can_face, sample_surface


def random_triangles(rng: np.random.Generator, count: int) -> SurfaceMesh:
    vertices = rng.uniform(-0.1, 0.1, (3 * count, 3))
    vertices[2] = vertices[0] + 0.37 * (vertices[1] - vertices[0]) + 1e-7  # a needle
    return SurfaceMesh(vertices, np.arange(3 * count).reshape(-1, 3), "random", True)


def random_pose(rng: np.random.Generator) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    pose[:3, 3] = rng.uniform(-1, 1, 3)
    return pose


@pytest.mark.parametrize("spacing_m", [1.0, 0.05, 0.004])
def test_area_and_first_two_moments_of_every_face_are_exact(
    rng: np.random.Generator, spacing_m: float
) -> None:
    mesh = random_triangles(rng, 20)
    for face in range(len(mesh.faces)):
        samples = sample_surface(mesh, np.eye(4), spacing_m, keep=np.arange(20) == face)
        corners = mesh.triangles_m[face]
        center = corners.mean(axis=0)
        assert samples.areas_m2.sum() == pytest.approx(mesh.areas_m2[face], rel=1e-12)
        assert np.average(samples.points_m, axis=0, weights=samples.areas_m2) == pytest.approx(
            center, abs=1e-14
        )
        # Trace of the covariance: between the pieces plus within them gives that of the whole.
        between = np.average(((samples.points_m - center) ** 2).sum(axis=1), weights=samples.areas_m2)
        within = np.average(2 * samples.spread_m2, weights=samples.areas_m2)
        assert between + within == pytest.approx(((corners - center) ** 2).sum() / 12, rel=1e-9)
        assert np.allclose(samples.normals, mesh.normals[face], atol=1e-12)


def test_spread_of_one_triangle_agrees_with_random_points(rng: np.random.Generator) -> None:
    corners = np.array([[0.0, 0, 0], [0.03, 0, 0.01], [0.005, 0.02, 0]])
    mesh = SurfaceMesh(corners, np.array([[0, 1, 2]]), "one", True)
    samples = sample_surface(mesh, np.eye(4), 1.0)
    assert samples.points_m == pytest.approx(corners.mean(axis=0)[None])
    weights = rng.dirichlet([1, 1, 1], 400_000)  # uniform over the triangle
    variance = np.trace(np.cov((weights @ corners).T)) / 2
    assert samples.spread_m2[0] == pytest.approx(variance, rel=5e-3)


def test_pieces_respect_the_spacing(rng: np.random.Generator) -> None:
    mesh = random_triangles(rng, 20)
    spacing_m = 0.01
    samples = sample_surface(mesh, np.eye(4), spacing_m)
    # A triangle with edges up to s has sum l^2 / 72 <= s^2 / 24 and an area up to sqrt(3) / 4 s^2.
    assert samples.spread_m2.max() <= spacing_m**2 / 24 * (1 + 1e-9)
    assert samples.areas_m2.max() <= math.sqrt(3) / 4 * spacing_m**2
    # No piece of a well-shaped face is much smaller than needed: m pieces an edge, m - 1 are too few.
    box = sample_surface(load_mesh(primitives.box(0.1, 0.1, 0.1)), np.eye(4), spacing_m)
    assert box.areas_m2.min() >= spacing_m**2 / 8


def test_a_right_triangle_is_divided_as_by_hand() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    mesh = SurfaceMesh(corners, np.array([[0, 1, 2]]), "one", True)
    samples = sample_surface(mesh, np.eye(4), 1.0)
    by_hand = np.array([[1, 1, 0], [1, 4, 0], [2, 2, 0], [4, 1, 0]]) / 6
    order = np.lexsort(samples.points_m.T[::-1].round(9))
    assert samples.points_m[order] == pytest.approx(by_hand)
    assert samples.areas_m2.tolist() == [0.125] * 4
    assert len(sample_surface(mesh, np.eye(4), math.sqrt(2)).areas_m2) == 1
    assert len(sample_surface(mesh, np.eye(4), 0.5).areas_m2) == 9


def test_a_needle_is_cut_across_and_not_along() -> None:
    # 100 mm x 0.1 mm: similar triangles up to a millimetre would be 10 000.
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.05, 1e-4, 0]])
    samples = sample_surface(SurfaceMesh(corners, np.array([[0, 1, 2]]), "needle", True), np.eye(4), 1e-3)
    assert 100 <= len(samples.areas_m2) <= 1500
    assert samples.areas_m2.sum() == pytest.approx(5e-6)


def test_samples_move_with_the_pose(rng: np.random.Generator) -> None:
    mesh = random_triangles(rng, 20)
    pose = random_pose(rng)
    still, moved = sample_surface(mesh, np.eye(4), 0.02), sample_surface(mesh, pose, 0.02)
    assert moved.points_m == pytest.approx(still.points_m @ pose[:3, :3].T + pose[:3, 3], abs=1e-14)
    assert moved.normals == pytest.approx(still.normals @ pose[:3, :3].T, abs=1e-14)
    assert np.array_equal(moved.areas_m2, still.areas_m2)
    assert np.array_equal(moved.spread_m2, still.spread_m2)


def test_samples_are_repeatable_and_in_the_order_of_the_faces(rng: np.random.Generator) -> None:
    mesh = random_triangles(rng, 30)
    first, second = sample_surface(mesh, np.eye(4), 0.01), sample_surface(mesh, np.eye(4), 0.01)
    for name in ("points_m", "normals", "areas_m2", "spread_m2"):
        assert np.array_equal(getattr(first, name), getattr(second, name))
    one_by_one = [sample_surface(mesh, np.eye(4), 0.01, keep=np.arange(30) == face) for face in range(30)]
    assert np.array_equal(first.points_m, np.concatenate([samples.points_m for samples in one_by_one]))
    kept = sample_surface(mesh, np.eye(4), 0.01, keep=np.arange(30) % 2 == 0)
    assert np.array_equal(kept.points_m, np.concatenate([samples.points_m for samples in one_by_one[::2]]))


def test_no_faces_give_no_samples() -> None:
    samples = sample_surface(load_mesh(primitives.plate(0.1, 0.1)), np.eye(4), 0.01, keep=np.zeros(2, bool))
    assert samples.points_m.shape == samples.normals.shape == (0, 3)
    assert samples.areas_m2.shape == samples.spread_m2.shape == (0,)


def test_a_smooth_integral_converges_at_second_order() -> None:
    # One flat face: no error of the geometry, only that of the centroid rule.
    mesh = SurfaceMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), "one", True)
    errors = []
    for spacing_m in math.sqrt(2) / np.array([4, 8, 16, 32]):
        samples = sample_surface(mesh, np.eye(4), spacing_m)
        x, y, _ = samples.points_m.T
        errors.append(abs((np.exp(x + 2 * y) * samples.areas_m2).sum() - ((math.e - 1) ** 2 / 2)))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ratios == pytest.approx(4, rel=0.1)


def test_the_echo_integral_of_a_sphere_converges_at_second_order() -> None:
    # Integral of exp(i q z) over a sphere = 4 pi r^2 sinc(q r); mesh and spacing are refined together.
    radius_m, wavenumber = 0.05, 200.0
    exact = 4 * math.pi * radius_m * math.sin(wavenumber * radius_m) / wavenumber
    errors = []
    for subdivisions in (3, 4, 5):
        mesh = load_mesh(trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m))
        samples = sample_surface(mesh, np.eye(4), 0.16 * radius_m * 2.0 ** (3 - subdivisions))
        integral = (np.exp(1j * wavenumber * samples.points_m[:, 2]) * samples.areas_m2).sum()
        errors.append(abs(integral - exact))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.2)


@pytest.mark.parametrize("spacing_m", [1e-6, 1e-4, 1e-9])
def test_absurd_counts_are_refused_at_once(spacing_m: float) -> None:
    mesh = load_mesh(primitives.box(1.0, 1.0, 1.0))
    with pytest.raises(MeshError, match="larger spacing") as caught:
        sample_surface(mesh, np.eye(4), spacing_m)
    assert caught.value.code == "mesh.too_many_samples"


def test_the_count_known_beforehand_is_exact(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    for mesh in (random_triangles(rng, 20), load_mesh(primitives.sphere(0.05, 0.01))):
        count = len(sample_surface(mesh, np.eye(4), 2e-3).areas_m2)
        monkeypatch.setattr(tessellation, "MAX_SAMPLES", count)
        assert len(sample_surface(mesh, np.eye(4), 2e-3).areas_m2) == count
        monkeypatch.setattr(tessellation, "MAX_SAMPLES", count - 1)
        with pytest.raises(MeshError, match="limit"):
            sample_surface(mesh, np.eye(4), 2e-3)
        monkeypatch.undo()


@pytest.mark.parametrize("spacing_m", [0.0, -1.0, math.nan, math.inf])
def test_spacing_must_be_positive(spacing_m: float) -> None:
    with pytest.raises(MeshError, match="spacing_m must be a positive number"):
        sample_surface(load_mesh(primitives.plate(0.1, 0.1)), np.eye(4), spacing_m)


def test_the_cull_keeps_every_face_that_faces_some_pair(rng: np.random.Generator) -> None:
    mesh = load_mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.05))
    for _ in range(20):
        tx_m = rng.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 0.6], (15, 3))
        rx_m = tx_m + rng.uniform(-0.02, 0.02, (15, 3))
        kept = faces_that_can_face(mesh.triangles_m, mesh.normals, False, tx_m, rx_m)
        centers = mesh.triangles_m.mean(axis=1)
        facing = [
            np.einsum("fj,fnj->fn", mesh.normals, antenna_m - centers[:, None]) > 0
            for antenna_m in (tx_m, rx_m)
        ]
        lit = (facing[0] & facing[1]).any(axis=1)
        assert not (lit & ~kept).any()


def test_the_cull_drops_what_lies_behind_and_nothing_of_a_sheet() -> None:
    mesh = load_mesh(primitives.box(0.1, 0.1, 0.1))
    above = np.array([[-0.04, 0, 0.4], [0.04, 0, 0.4]])
    kept = faces_that_can_face(mesh.triangles_m, mesh.normals, False, above, above)
    assert np.array_equal(kept, mesh.normals[:, 2] > 0.5)
    # A transmitter above and a receiver below share only the sides, and those only if they stand beside them.
    below = above * [1, 1, -1]
    assert not faces_that_can_face(mesh.triangles_m, mesh.normals, False, above, below).any()
    assert faces_that_can_face(mesh.triangles_m, mesh.normals, True, above, above).all()
