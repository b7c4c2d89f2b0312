"""Rotations in torch, to compose a pose in front of the differentiable model."""

from __future__ import annotations

import torch


def rotation_matrix(turn_rad: torch.Tensor) -> torch.Tensor:
    """Rotation (3, 3) by |turn| about the direction of `turn_rad` (3,), differentiable at zero, too.

    The exponential of the cross product matrix; `rigid_pose.rotation_matrix` in torch.
    """
    zero = torch.zeros_like(turn_rad[0])
    x, y, z = turn_rad
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
    rotation: torch.Tensor = torch.linalg.matrix_exp(cross)
    return rotation
