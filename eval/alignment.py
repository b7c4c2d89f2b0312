"""Registration of a cloud to the ground truth before it is scored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from waveformer.datagen.truth_cloud import TruthCloud, finite_points
from waveformer.simulator.errors import MeshError

MAX_ROTATION_DEG = 10.0
MAX_SHIFT_M = 0.03

_MAX_ROUNDS = 50
_STILL_RADII = 1e-5
# Every n-th point where there are more: a motion has six unknowns.
_MAX_POINTS = 4000
# The worst tenth of the pairs is left out: stray points and parts that the truth does not have.
_KEPT_SHARE = 0.9
# Motions that change the distances less than this, relative to the strongest one, are left alone: a plane must
# not slide along itself, nor a ball turn.
_WEAKEST_MOTION = 0.05


@dataclass(frozen=True, eq=False)
class Alignment:
    """A rigid motion of a cloud towards the ground truth.

    Attributes:
        kind: "known_pose" or "icp".
        transform: 4 x 4, applied to the cloud's points.
        rotation_deg: angle of its rotation.
        shift_m: how far it moves the cloud's centroid.
        rms_m: of the pairs' distances along the normals after the motion; None for the known pose.
    """

    kind: str
    transform: NDArray[np.float64]
    rotation_deg: float = 0.0
    shift_m: float = 0.0
    rms_m: float | None = None

    def apply(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """The moved points, (P, 3)."""
        points = finite_points("cloud", points_m)
        return points @ self.transform[:3, :3].T + self.transform[:3, 3]


def known_pose() -> Alignment:
    """No motion: the pose of the object is known, as in the paper."""
    return Alignment("known_pose", np.eye(4))


def align_by_icp(points_m: ArrayLike, truth: TruthCloud) -> Alignment:
    """Iterated closest points, point to plane (Chen and Medioni 1992), limited to 10 degrees and 3 cm.

    The rotation is about the cloud's centroid. A step beyond a limit is cut back to it. Of 90 % of the points, the
    nearest ones, the distance to the tangent plane of the nearest ground-truth point is minimised.

    Args:
        points_m: (P, 3) metres in the frame of the truth; P = 0 is left alone.
        truth: with normals.

    Raises:
        MeshError: the truth has no normals, or the cloud has another shape or is not finite.
    """
    if truth.normals is None:
        raise MeshError("truth.normals", "ICP needs ground-truth normals: sample the truth from a mesh")
    points = finite_points("cloud", points_m)
    if len(points) == 0:
        return Alignment("icp", np.eye(4))
    # In radii, so that rotations and shifts weigh alike in the least squares.
    center_m = points.mean(axis=0)
    start = truth.to_unit_sphere(points[:: -(-len(points) // _MAX_POINTS)])
    center = truth.to_unit_sphere(center_m)
    limit = MAX_SHIFT_M / truth.radius_m
    rotation, shift = Rotation.identity(), np.zeros(3)
    for _ in range(_MAX_ROUNDS):
        moved = rotation.apply(start - center) + center + shift
        turn, step = _step(moved, truth, truth.normals, center + shift)
        before = rotation, shift
        rotation = _limited_rotation(Rotation.from_rotvec(turn) * rotation)
        shift = _limited(shift + step, limit)
        moved_by = (rotation * before[0].inv()).magnitude() + np.linalg.norm(shift - before[1])
        if moved_by < _STILL_RADII:
            break
    _, residual, _ = _pairs(rotation.apply(start - center) + center + shift, truth, truth.normals)
    transform = np.eye(4)
    transform[:3, :3] = rotation.as_matrix()
    transform[:3, 3] = center_m + shift * truth.radius_m - rotation.apply(center_m)
    return Alignment(
        "icp",
        transform,
        float(np.rad2deg(rotation.magnitude())),
        float(np.linalg.norm(shift) * truth.radius_m),
        float(np.sqrt((residual**2).mean()) * truth.radius_m),
    )


def _pairs(
    points: NDArray[np.float64], truth: TruthCloud, normals: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The nearer points, their heights over the tangent planes of their partners, and those planes' normals."""
    distance, partner = truth.tree.query(points)
    kept = distance <= np.quantile(distance, _KEPT_SHARE)
    normal = normals[partner[kept]]
    height = np.einsum("pi,pi->p", points[kept] - np.asarray(truth.tree.data)[partner[kept]], normal)
    return points[kept], height, normal


def _step(
    points: NDArray[np.float64],
    truth: TruthCloud,
    normals: NDArray[np.float64],
    center: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation vector about `center` and shift that minimise the linearised heights."""
    near, height, normal = _pairs(points, truth, normals)
    system = np.concatenate([np.cross(near - center, normal), normal], axis=1)
    motion = np.linalg.lstsq(system, -height, rcond=_WEAKEST_MOTION)[0]
    return motion[:3], motion[3:]


def _limited_rotation(rotation: Rotation) -> Rotation:
    return Rotation.from_rotvec(_limited(rotation.as_rotvec(), np.deg2rad(MAX_ROTATION_DEG)))


def _limited(vector: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    length = float(np.linalg.norm(vector))
    return vector * (limit / length) if length > limit else vector
