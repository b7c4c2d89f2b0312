"""What a viewpoint sees, by rays and from points alone."""

import numpy as np
import pytest
import trimesh

from waveformer.datagen.point_visibility import facing_normals, visible_hidden_point_removal, visible_rays
from waveformer.simulator.errors import MeshError
from waveformer.simulator.scene import build_scene

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

RADIUS_M, DEPTH_M = 0.05, 0.4
ORIGIN = np.zeros(3)


def scene_of(*meshes):
    return build_scene([(np.asarray(mesh.vertices), np.asarray(mesh.faces)) for mesh in meshes])


@pytest.fixture
def ball(rng):
    """Scene, points and normals of a ball below the viewpoint, and which points its horizon leaves visible."""
    normals = rng.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points_m = RADIUS_M * normals - [0, 0, DEPTH_M]
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_M).apply_translation((0, 0, -DEPTH_M))
    # A tangent from the viewpoint touches where cos = radius / distance of the centre.
    return scene_of(mesh), points_m, normals, normals[:, 2] > RADIUS_M / DEPTH_M


def test_rays_see_up_to_the_horizon(ball):
    scene, points_m, normals, expected = ball
    # Facets of the mesh are 2 degrees wide: along the horizon that is 2 % of the points.
    assert (visible_rays(points_m, normals, scene, ORIGIN) == expected).mean() > 0.98


def test_hidden_point_removal_sees_up_to_the_horizon(ball):
    _, points_m, _, expected = ball
    seen = visible_hidden_point_removal(points_m, ORIGIN)
    # The horizon of the flipped points is off by a few degrees: Katz et al., section 4.
    assert (seen == expected).mean() > 0.95


def test_a_plate_casts_a_shadow():
    plates = [trimesh.creation.box((0.1, 0.1, 0.002)).apply_translation((0, 0, z)) for z in (-0.2, -0.4)]
    x = np.linspace(-0.19, 0.19, 39)
    below = np.stack([x, 0 * x, np.full(39, -0.399)], axis=1)
    wide = trimesh.creation.box((0.5, 0.5, 0.002)).apply_translation((0, 0, -0.4))
    seen = visible_rays(below, np.tile([0.0, 0, 1], (39, 1)), scene_of(plates[0], wide), ORIGIN)
    # The lower rim of the upper plate, 0.201 m away, throws the widest shadow down to 0.399 m.
    assert np.array_equal(seen, np.abs(x) > 0.05 * 0.399 / 0.199)


def test_a_pose_moves_the_scene(ball, rng):
    scene, points_m, normals, _ = ball
    pose = np.eye(4)
    pose[:3, :3], _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose[:3, :3] *= np.linalg.det(pose[:3, :3])
    pose[:3, 3] = [0.2, -0.1, 0.3]
    moved = visible_rays(
        points_m @ pose[:3, :3].T + pose[:3, 3], normals @ pose[:3, :3].T, scene, pose[:3, 3], pose
    )
    here = visible_rays(points_m, normals, scene, ORIGIN)
    # float32 rays may decide otherwise at the rim of a facet
    assert (moved == here).mean() > 0.999


def test_normals_are_turned_towards_the_viewpoint():
    points_m = np.array([[0.0, 0, -1], [0.0, 0, -1], [0.0, 0, 2]])
    normals = np.array([[0.0, 0, 1], [0.0, 0, -1], [0.0, 0, 1]])
    assert facing_normals(points_m, normals, ORIGIN)[:, 2].tolist() == [1, 1, -1]


def test_a_point_at_the_viewpoint_is_refused():
    with pytest.raises(MeshError, match="at the viewpoint"):
        visible_hidden_point_removal(np.array([[0.0, 0, 0], [0, 0, -1]]), ORIGIN)


@pytest.mark.parametrize("count", [0, 2, 10])
def test_points_in_a_plane_with_the_viewpoint_are_refused(count):
    x = np.linspace(-0.1, 0.1, count)
    with pytest.raises(MeshError, match="hidden-point removal") as refusal:
        visible_hidden_point_removal(np.stack([x, 0 * x, np.full(count, -0.3)], axis=1), ORIGIN)
    assert refusal.value.code == "visibility.hull"
