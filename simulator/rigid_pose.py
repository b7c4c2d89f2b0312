"""Rigid poses about the middle of an object: where turning and shifting are least entangled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.target import Target


@dataclass(frozen=True, eq=False)
class RigidPose:
    """Takes a point p, given relative to the object's middle, to ``rotation @ p + center_m``.

    Attributes:
        rotation: shape (3, 3).
        center_m: the object's middle in the radar frame, shape (3,).
    """

    rotation: NDArray[np.float64]
    center_m: NDArray[np.float64]

    @classmethod
    def of(cls, pose: ArrayLike, middle_m: NDArray[np.float64]) -> RigidPose:
        """The same as a pose (4, 4) of an object whose middle lies at `middle_m` in mesh coordinates.

        Raises:
            MeshError: the pose is not rigid.
        """
        checked = Target("", pose=np.asarray(pose)).pose
        return cls(checked[:3, :3], checked[:3, :3] @ middle_m + checked[:3, 3])

    def matrix(self, middle_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pose (4, 4) for mesh coordinates; the inverse of `of`."""
        pose = np.eye(4)
        pose[:3, :3] = self.rotation
        pose[:3, 3] = self.center_m - self.rotation @ middle_m
        return pose

    def moved(self, motion: ArrayLike) -> RigidPose:
        """Shifted by ``motion[:3]`` metres and turned about the middle by the rotation vector ``motion[3:]``."""
        motion = np.asarray(motion, dtype=np.float64)
        return RigidPose(rotation_matrix(motion[3:]) @ self.rotation, self.center_m + motion[:3])

    def apart(self, other: RigidPose) -> tuple[float, float]:
        """Metres between the middles, and degrees of the turn between both."""
        cosine = 0.5 * (np.trace(self.rotation @ other.rotation.T) - 1.0)
        sine = 0.5 * np.linalg.norm(_axial(self.rotation @ other.rotation.T))
        angle = float(np.degrees(np.arctan2(sine, cosine)))
        return float(np.linalg.norm(self.center_m - other.center_m)), angle


def rotation_matrix(turn_rad: ArrayLike) -> NDArray[np.float64]:
    """Rotation (3, 3) by |turn| about the direction of `turn_rad` (3,), Rodrigues' formula."""
    turn = np.asarray(turn_rad, dtype=np.float64)
    angle = float(np.linalg.norm(turn))
    cross = np.array([[0.0, -turn[2], turn[1]], [turn[2], 0.0, -turn[0]], [-turn[1], turn[0], 0.0]])
    # sinc(x) is sin(pi x) / (pi x), and 1 - cos a = 2 sin^2(a / 2)
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * cross @ cross)


def _axial(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
