"""Signed distances against closed forms and brute force."""

import numpy as np
import pytest
import trimesh

from waveformer.eval.mesh_distance import signed_distance_m
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import load_mesh


def test_box():
    box = load_mesh(trimesh.creation.box((2.0, 2.0, 2.0)))
    points = [(0, 0, 0.5), (0.3, 0.2, 1.5), (2, 2, 0), (2, 2, 2), (0.1, -1.25, 0.3)]
    expected = [-0.5, 0.5, np.sqrt(2), np.sqrt(3), 0.25]
    np.testing.assert_allclose(signed_distance_m(points, box), expected, rtol=1e-12)


def brute_force_m(points, mesh):
    """Distance by closest points on all triangles, found among all their convex combinations in closed form."""
    triangles = mesh.triangles_m
    found = np.full(len(points), np.inf)
    for triangle in triangles:
        closest = trimesh.triangles.closest_point(np.repeat(triangle[None], len(points), axis=0), points)
        found = np.minimum(found, np.linalg.norm(points - closest, axis=1))
    return found


def test_any_closed_mesh(rng):
    hull = trimesh.convex.convex_hull(rng.normal(size=(40, 3)) * 0.05)
    mesh = load_mesh(hull)
    points = rng.normal(size=(300, 3)) * 0.08
    distance = signed_distance_m(points, mesh)
    np.testing.assert_allclose(np.abs(distance), brute_force_m(points, mesh), atol=1e-12)
    # Inside a convex body is behind all of its faces.
    above = np.einsum("pfc,fc->pf", points[:, None] - mesh.triangles_m[None, :, 0], mesh.normals)
    assert np.array_equal(distance < 0, (above < 0).all(axis=1))


def test_no_points_and_bad_points():
    box = load_mesh(trimesh.creation.box((0.1, 0.1, 0.1)))
    assert signed_distance_m([], box).shape == (0,)
    with pytest.raises(MeshError, match="not finite"):
        signed_distance_m([(np.nan, 0, 0)], box)
