import numpy as np
import pytest

from waveformer.datagen.resting_pose import center_of_hull, resting_rotation
from waveformer.simulator import primitives


def rested(mesh, rng):
    return mesh.vertices @ resting_rotation(mesh.vertices, rng).T


def test_a_box_rests_on_one_of_its_sides(rng):
    mesh = primitives.box(0.05, 0.08, 0.12)
    heights = {round(float(np.ptp(rested(mesh, rng)[:, 2])), 6) for _ in range(60)}
    assert heights == {0.05, 0.08, 0.12}


def test_a_tall_box_stands_less_often_than_it_lies(rng):
    """Dropped at random, a side is met in proportion to the solid angle under which the centre sees it."""
    mesh = primitives.box(0.04, 0.04, 0.16)
    standing = np.mean([np.ptp(rested(mesh, rng)[:, 2]) > 0.15 for _ in range(400)])
    a, d = 0.02, 0.08
    solid_angle = 4 * np.arcsin(a * a / (a * a + d * d))  # of a square of half side a, at distance d
    expected = 2 * solid_angle / (4 * np.pi)
    assert abs(standing - expected) < 4 * np.sqrt(expected * (1 - expected) / 400)


def test_the_centre_stands_above_the_support(rng):
    """At rest no small tilt brings the centre of mass down."""
    mesh = primitives.mug(0.004)
    for _ in range(10):
        points = rested(mesh, rng)
        hull = mesh.convex_hull
        rotation = np.linalg.lstsq(
            mesh.vertices - mesh.vertices.mean(0), points - points.mean(0), rcond=None
        )[0].T
        center = rotation @ hull.center_mass
        points = mesh.vertices @ rotation.T
        support = points[points[:, 2] < points[:, 2].min() + 1e-6][:, :2]
        assert len(support) >= 3
        low, high = support.min(axis=0), support.max(axis=0)
        assert (center[:2] >= low - 1e-6).all() and (center[:2] <= high + 1e-6).all()


def test_a_flat_object_lies_flat(rng):
    mesh = primitives.plate(0.1, 0.2)
    for _ in range(5):
        assert np.ptp(rested(mesh, rng)[:, 2]) < 1e-9


def test_rotations_are_proper_and_seeded():
    mesh = primitives.hammer(0.004)
    first, again = (resting_rotation(mesh.vertices, np.random.default_rng(0)) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(first @ first.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(first) == pytest.approx(1.0)


def test_centre_of_a_hull_is_that_of_the_solid():
    mesh = primitives.hammer(0.004).convex_hull
    np.testing.assert_allclose(
        center_of_hull(mesh.vertices, mesh.faces), mesh.center_mass, atol=1e-9 * mesh.scale
    )
