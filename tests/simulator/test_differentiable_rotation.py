"""Rotations in torch: those of NumPy, and their derivative where nothing turns."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from waveformer.simulator import rigid_pose
from waveformer.simulator.differentiable_rotation import rotation_matrix


@pytest.mark.parametrize("size_rad", [0.0, 1e-9, 0.3, 3.0, 7.0])
def test_it_is_the_rotation_of_rigid_poses(rng: np.random.Generator, size_rad: float) -> None:
    turn = size_rad * rng.normal(size=3) / np.sqrt(3)
    rotation = rotation_matrix(torch.from_numpy(turn)).numpy()
    # rounding of the exponential's series
    np.testing.assert_allclose(rotation, rigid_pose.rotation_matrix(turn), atol=1e-13)


def test_where_nothing_turns_the_derivative_is_the_cross_product() -> None:
    point = torch.tensor([0.3, -0.2, 0.5], dtype=torch.float64)
    still = torch.zeros(3, dtype=torch.float64)
    jacobian = torch.autograd.functional.jacobian(lambda turn: rotation_matrix(turn) @ point, still)
    expected = torch.linalg.cross(torch.eye(3, dtype=torch.float64), point[None].expand(3, 3)).T
    assert torch.allclose(jacobian, expected, atol=1e-14)
