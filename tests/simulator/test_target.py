"""Targets: poses that are rigid, and the forms in which targets may be given."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from waveformer.simulator import primitives
from waveformer.simulator.errors import MeshError
from waveformer.simulator.materials import Material
from waveformer.simulator.target import Target, as_targets, rotate

MESH = primitives.plate(0.1, 0.1)


def test_a_perfect_conductor_turns_the_sign_of_the_field() -> None:
    assert Material.pec().is_conductor


def test_a_target_is_a_perfect_conductor_at_the_origin_unless_told_otherwise() -> None:
    target = Target(MESH)
    assert target.material == Material.pec()
    assert (target.pose == np.eye(4)).all()


def test_a_pose_is_copied_and_read_only() -> None:
    pose = np.eye(4)
    target = Target(MESH, pose=pose)
    pose[0, 3] = 1
    assert target.pose[0, 3] == 0
    with pytest.raises(ValueError, match="read-only"):
        target.pose[0, 3] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        target.pose = pose  # type: ignore[misc]


def test_any_rotation_with_a_translation_is_a_pose(rng: np.random.Generator) -> None:
    for _ in range(20):
        pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
        pose[:3, 3] = rng.normal(size=3)
        assert Target(MESH, pose=pose).pose == pytest.approx(pose)


@pytest.mark.parametrize(
    ("pose", "code"),
    [
        (np.eye(3), "pose.shape"),
        (np.full((4, 4), np.nan), "pose.shape"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "pose.rigid"),
        (np.diag([1.0, 1.0, 1.01, 1.0]), "pose.rigid"),
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "pose.rigid"),  # a mirror image
        (np.diag([0.0, 1.0, 1.0, 1.0]), "pose.rigid"),
    ],
)
def test_a_pose_that_is_not_rigid_is_refused(pose: Any, code: str) -> None:
    with pytest.raises(MeshError) as caught:
        Target(MESH, pose=pose)
    assert caught.value.code == code


def test_a_transposed_pose_is_refused() -> None:
    transposed = trimesh.transformations.translation_matrix([0, 0, -0.4]).T
    with pytest.raises(MeshError):
        Target(MESH, pose=transposed)


def test_rotate_applies_the_rotation_and_not_its_transpose() -> None:
    quarter_turn = np.eye(4)
    quarter_turn[:2, :2] = [[0, -1], [1, 0]]  # x to y, y to -x
    assert rotate(np.array([[1.0, 0, 0], [0, 1, 0]]), quarter_turn) == pytest.approx(
        np.array([[0.0, 1, 0], [-1, 0, 0]])
    )


def test_one_mesh_path_or_target_becomes_a_list_of_one() -> None:
    target = Target(MESH)
    assert as_targets(target) == [target]
    assert [item.mesh for item in as_targets(MESH)] == [MESH]
    assert as_targets("mug.stl")[0].mesh == "mug.stl"
    assert as_targets(Path("mug.stl"))[0].mesh == Path("mug.stl")


def test_a_sequence_keeps_its_order_and_its_targets() -> None:
    target = Target(MESH)
    items = as_targets((target, "mug.stl", MESH))
    assert items[0] is target
    assert [items[1].mesh, items[2].mesh] == ["mug.stl", MESH]


@pytest.mark.parametrize("nothing", [[], ()])
def test_no_target_is_refused(nothing: Any) -> None:
    with pytest.raises(MeshError, match="at least one mesh"):
        as_targets(nothing)
