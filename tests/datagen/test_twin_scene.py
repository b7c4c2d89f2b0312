"""Objects at rest below the aperture."""

import hashlib

import numpy as np
import pytest
import trimesh

from waveformer.datagen.twin_objects import TwinObject
from waveformer.datagen.twin_scene import TwinScene, resting_pose
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.simulator.errors import MeshError


@pytest.fixture
def scene(tmp_path):
    """A block of 20 x 40 x 60 mm that MITO turned by 90 degrees about y, then z (number 003)."""
    path = tmp_path / "003_block.ply"
    trimesh.creation.box((0.02, 0.04, 0.06)).apply_translation((1, 2, 3)).export(path)
    return TwinScene.load(TwinObject("003_block", path), TwinSettings())


def test_turned_at_rest_and_centred(scene):
    # y: x -> -z, z -> x; then z: x -> y, y -> -x: sides along x, y, z are 40, 60, 20 mm
    assert scene.bounds_m == pytest.approx(np.array([[-0.02, -0.03, -0.45], [0.02, 0.03, -0.43]]), abs=1e-6)
    assert scene.rotation_known
    assert scene.rotation_deg == (0, 90, 90)
    assert np.linalg.det(scene.pose[:3, :3]) == pytest.approx(1)


def test_truth_is_the_mesh_in_the_radar_frame(scene):
    homogeneous = np.c_[scene.mesh.vertices_m, np.ones(len(scene.mesh.vertices_m))]
    assert scene.truth.vertices_m == pytest.approx((homogeneous @ scene.pose.T)[:, :3])
    assert (scene.truth.faces == scene.mesh.faces).all()


def test_turns_are_about_fixed_axes_in_order():
    pose = resting_pose(np.eye(3), (90.0, 0.0, 90.0), -0.45)
    # x: y -> z; then z: x -> y
    assert pose[:3, :3] @ [1, 0, 0] == pytest.approx([0, 1, 0])
    assert pose[:3, :3] @ [0, 1, 0] == pytest.approx([0, 0, 1])


def test_crop_leaves_30_30_45_mm(scene):
    margin = np.array([0.03, 0.03, 0.045])
    assert scene.crop_m == pytest.approx(scene.bounds_m + [-margin, margin])


def test_an_unknown_object_is_not_turned(tmp_path):
    path = tmp_path / "mug.ply"
    trimesh.creation.box((0.02, 0.04, 0.06)).export(path)
    scene = TwinScene.load(TwinObject("mug", path), TwinSettings(support_z_m=-0.3))
    assert not scene.rotation_known
    assert scene.bounds_m == pytest.approx(np.array([[-0.01, -0.02, -0.3], [0.01, 0.02, -0.24]]), abs=1e-7)
    assert scene.describe()["mesh"]["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_missing_mesh(tmp_path):
    with pytest.raises(MeshError, match="cannot be read"):
        TwinScene.load(TwinObject("a", tmp_path / "a.ply"), TwinSettings())
