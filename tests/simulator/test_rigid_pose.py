"""Poses about the middle of an object."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from waveformer.simulator.errors import MeshError
from waveformer.simulator.rigid_pose import RigidPose, rotation_matrix

MIDDLE_M = np.array([0.03, -0.01, 0.2])


def some_pose(rng: np.random.Generator) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(rng=rng).as_matrix()
    pose[:3, 3] = rng.normal(size=3)
    return pose


@pytest.mark.parametrize("degrees", [0.0, 1e-7, 1e-3, 20.0, 179.999])
def test_rotation_vectors_are_those_of_scipy(rng: np.random.Generator, degrees: float) -> None:
    turn = rng.normal(size=3)
    turn *= np.radians(degrees) / np.linalg.norm(turn)
    expected = Rotation.from_rotvec(turn).as_matrix()
    np.testing.assert_allclose(rotation_matrix(turn), expected, atol=1e-15)  # rounding


def test_a_pose_comes_back(rng: np.random.Generator) -> None:
    pose = some_pose(rng)
    back = RigidPose.of(pose, MIDDLE_M).matrix(MIDDLE_M)
    np.testing.assert_allclose(back, pose, atol=1e-15)


def test_the_middle_does_not_move_when_the_object_turns(rng: np.random.Generator) -> None:
    pose = RigidPose.of(some_pose(rng), MIDDLE_M)
    turned = pose.moved([0, 0, 0, 0.1, 0.2, -0.3]).matrix(MIDDLE_M)
    np.testing.assert_allclose(turned[:3, :3] @ MIDDLE_M + turned[:3, 3], pose.center_m, atol=1e-15)


def test_turns_are_about_axes_of_the_radar_frame(rng: np.random.Generator) -> None:
    pose = RigidPose.of(some_pose(rng), MIDDLE_M)
    turned = pose.moved([0, 0, 0, 0, 0, np.pi / 2]).rotation
    np.testing.assert_allclose(turned[2], pose.rotation[2], atol=1e-15)
    np.testing.assert_allclose(turned[0], -pose.rotation[1], atol=1e-15)


@pytest.mark.parametrize("degrees", [1e-5, 0.3, 5.0, 179.0])
def test_how_far_poses_are_apart(rng: np.random.Generator, degrees: float) -> None:
    pose = RigidPose.of(some_pose(rng), MIDDLE_M)
    turn = np.radians(degrees) * np.array([0.6, 0.0, -0.8])
    shift_m, turn_deg = pose.moved([0.003, 0.0, 0.004, *turn]).apart(pose)
    assert shift_m == pytest.approx(0.005)
    assert turn_deg == pytest.approx(degrees, rel=1e-6)  # rounding of 1e-16 rad in the rotation


def test_a_mirror_is_refused() -> None:
    with pytest.raises(MeshError, match="rigid"):
        RigidPose.of(np.diag([1.0, 1.0, -1.0, 1.0]), MIDDLE_M)
