"""Registration: recoveries, limits, and what must not move."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.eval.alignment import MAX_ROTATION_DEG, MAX_SHIFT_M, align_by_icp, known_pose
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import load_mesh

pytestmark = pytest.mark.usefixtures("mitsuba_variant")


@pytest.fixture
def truth(rng):
    """A body without symmetry: two boxes side by side."""
    body = trimesh.creation.box((0.12, 0.08, 0.05)) + trimesh.creation.box(
        (0.03, 0.05, 0.06)
    ).apply_translation((0.03, 0.01, 0.055))
    return sample_ground_truth(load_mesh(body), rng, 8000)


def displaced(points_m, rotation, shift_m):
    center_m = points_m.mean(axis=0)
    return rotation.apply(points_m - center_m) + center_m + shift_m


def test_known_pose_moves_nothing(rng):
    points = rng.normal(size=(10, 3))
    assert np.array_equal(known_pose().apply(points), points)
    assert known_pose().kind == "known_pose"


def test_recovers_a_displacement(truth, rng):
    turn, shift_m = Rotation.from_rotvec(np.deg2rad([3.0, -4.0, 2.0])), np.array([0.004, -0.006, 0.008])
    cloud = truth.points_m[rng.permutation(8000)[:3000]]
    alignment = align_by_icp(displaced(cloud, turn, shift_m), truth)
    # The cloud is a subset of the truth: exact but for the trimmed tenth and points at edges.
    error_m = np.linalg.norm(alignment.apply(displaced(cloud, turn, shift_m)) - cloud, axis=1)
    assert error_m.max() < 2e-4
    assert alignment.rotation_deg == pytest.approx(np.rad2deg(turn.magnitude()), abs=0.1)
    assert alignment.shift_m == pytest.approx(np.linalg.norm(shift_m), abs=2e-4)
    assert alignment.rms_m < 2e-4


def test_recovers_from_the_visible_part(truth):
    top = truth.points_m[truth.normals[:, 2] > -0.5]
    turn, shift_m = Rotation.from_rotvec(np.deg2rad([0.0, 3.0, 3.0])), np.array([0.003, 0.002, -0.005])
    alignment = align_by_icp(displaced(top, turn, shift_m), truth)
    error_m = np.linalg.norm(alignment.apply(displaced(top, turn, shift_m)) - top, axis=1)
    assert error_m.max() < 5e-4


def test_a_placed_cloud_stays(truth):
    alignment = align_by_icp(truth.points_m[:2000], truth)
    assert alignment.rotation_deg == pytest.approx(0, abs=1e-6)
    assert alignment.shift_m == pytest.approx(0, abs=1e-9)


def test_limits(truth):
    far = displaced(truth.points_m, Rotation.from_rotvec([0, 0, np.deg2rad(40)]), [0.0, 0.0, 0.2])
    alignment = align_by_icp(far, truth)
    assert alignment.rotation_deg <= MAX_ROTATION_DEG + 1e-9
    assert alignment.shift_m <= MAX_SHIFT_M + 1e-12
    assert alignment.shift_m > 0.029
    turn = Rotation.from_matrix(alignment.transform[:3, :3]).magnitude()
    assert np.rad2deg(turn) == pytest.approx(alignment.rotation_deg)
    moved_m = alignment.apply(far).mean(axis=0) - far.mean(axis=0)
    assert np.linalg.norm(moved_m) == pytest.approx(alignment.shift_m)


def test_a_plane_does_not_slide(rng):
    xy = rng.uniform(-0.05, 0.05, (4000, 2))
    plane = TruthCloud(np.pad(xy, ((0, 0), (0, 1))), np.tile([0.0, 0.0, 1.0], (4000, 1)))
    patch = np.pad(rng.uniform(0.0, 0.02, (300, 2)), ((0, 0), (0, 1))) + [0, 0, 0.004]
    alignment = align_by_icp(patch, plane)
    np.testing.assert_allclose(alignment.transform[:3, 3], [0, 0, -0.004], atol=1e-9)
    assert alignment.rotation_deg < 1e-6


def test_noise_does_not_make_a_plane_slide(rng):
    xy = rng.uniform(-0.05, 0.05, (4000, 2))
    normals = np.pad(0.01 * rng.normal(size=(4000, 2)), ((0, 0), (0, 1)), constant_values=1.0)
    plane = TruthCloud(np.pad(xy, ((0, 0), (0, 1))), normals)
    patch = np.concatenate([rng.uniform(0, 0.02, (300, 2)), 0.004 + 5e-4 * rng.normal(size=(300, 1))], axis=1)
    alignment = align_by_icp(patch, plane)
    # Free to slide, it would go 0.5 mm / (0.01 sqrt(300)) = 3 mm. Left is 4 mm times the mean tilt.
    moved_m = alignment.apply(patch).mean(axis=0) - patch.mean(axis=0)
    assert np.linalg.norm(moved_m[:2]) < 1e-4


def test_nothing_is_left_alone(truth):
    assert np.array_equal(align_by_icp([], truth).transform, np.eye(4))


def test_bad_input_is_refused(truth):
    with pytest.raises(MeshError, match="normals"):
        align_by_icp(truth.points_m, TruthCloud(truth.points_m))
    with pytest.raises(MeshError, match="not finite"):
        align_by_icp([(np.nan, 0, 0)], truth)
