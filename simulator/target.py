"""What the radar looks at: a mesh, its material and its pose."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.materials import Material

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class Target:
    """One object of a scene.

    Attributes:
        mesh: a trimesh.Trimesh or a path to a mesh file, in metres.
        material: reflection of its surface.
        pose: rigid transform (4, 4) that takes mesh coordinates to the radar frame.
    """

    mesh: trimesh.Trimesh | str | Path
    material: Material = field(default_factory=Material.pec)
    pose: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        try:
            pose = np.array(self.pose, dtype=np.float64)
        except (TypeError, ValueError):
            raise MeshError("pose.shape", "pose must be a 4x4 matrix of numbers") from None
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise MeshError("pose.shape", f"pose must be a finite 4x4 matrix, got shape {pose.shape}")
        rotation = pose[:3, :3]
        if not np.allclose(pose[3], [0.0, 0.0, 0.0, 1.0], atol=1e-9):
            raise MeshError(
                "pose.rigid",
                f"the last row of a pose must be 0 0 0 1, got {pose[3].tolist()}: is it transposed?",
            )
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(rotation) < 0:
            raise MeshError(
                "pose.rigid",
                "pose must be rigid (a rotation and a translation): scale or mirror the mesh instead",
            )
        pose.setflags(write=False)
        object.__setattr__(self, "pose", pose)


def rotate(vectors: NDArray[np.float64], pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (N, 3) turned by the rotation of a pose (4, 4)."""
    # einsum: BLAS takes a slow path for a transposed view, and its last bits may depend on threads
    return np.asarray(np.einsum("ni,ji->nj", vectors, pose[:3, :3]))


def as_targets(targets: Any) -> list[Target]:
    """A mesh, path or Target, or a sequence of them, as a list of Targets."""
    items = targets if isinstance(targets, (list, tuple)) else [targets]
    if not items:
        raise MeshError("mesh.none", "no target given: simulate needs at least one mesh")
    return [item if isinstance(item, Target) else Target(item) for item in items]
