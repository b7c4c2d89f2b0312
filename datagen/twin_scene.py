"""An object where the twin's radar finds it: turned as MITO had it, at rest below the middle of the aperture."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from waveformer.datagen.mito_offsets import rotation_offset_deg
from waveformer.datagen.twin_objects import TwinObject
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.target import rotate

# Air around the object's box that is imaged: along z about one range bin, across less.
CROP_MARGIN_M = (0.030, 0.030, 0.045)


@dataclass(frozen=True, eq=False)
class TwinScene:
    """One object in the radar frame.

    Attributes:
        item: which object.
        mesh: its surface as the file has it, cleaned.
        pose: rigid transform (4, 4) from the file to the radar frame.
        rotation_deg: turns about the fixed x, then y, then z axis.
        rotation_known: whether MITO's table has the object; otherwise it is not turned.
        mesh_sha256: of the file.
        reflectivity: real factor on the echo of a perfect conductor.
    """

    item: TwinObject
    mesh: SurfaceMesh
    pose: NDArray[np.float64]
    rotation_deg: tuple[float, float, float]
    rotation_known: bool
    mesh_sha256: str
    reflectivity: float

    @classmethod
    def load(cls, item: TwinObject, settings: TwinSettings) -> TwinScene:
        """Load and place an object; raises MeshError if its mesh cannot be used."""
        digest = file_sha256(item)
        mesh = load_mesh(item.path)
        known = rotation_offset_deg(item.object_id)
        rotation_deg = known or (0.0, 0.0, 0.0)
        pose = resting_pose(mesh.vertices_m, rotation_deg, settings.support_z_m)
        reflectivity = settings.reflectivity(item.object_id)
        return cls(item, mesh, pose, rotation_deg, known is not None, digest, reflectivity)

    @property
    def truth(self) -> SurfaceMesh:
        """The surface in the radar frame."""
        return replace(
            self.mesh, vertices_m=rotate(self.mesh.vertices_m, self.pose) + self.pose[:3, 3], problems=()
        )

    @property
    def bounds_m(self) -> NDArray[np.float64]:
        """Lower and upper corner of the object's box, shape (2, 3)."""
        vertices_m = self.truth.vertices_m
        return np.array([vertices_m.min(axis=0), vertices_m.max(axis=0)])

    @property
    def crop_m(self) -> NDArray[np.float64]:
        """Lower and upper corner of the box to be imaged, shape (2, 3)."""
        return np.asarray(self.bounds_m + np.array([[-1.0], [1.0]]) * np.array(CROP_MARGIN_M))

    def describe(self) -> dict[str, Any]:
        """The truth beside the mesh, as JSON values."""
        return {
            "object_id": self.item.object_id,
            "mesh": {"path": str(self.item.path.absolute()), "sha256": self.mesh_sha256},
            "pose": self.pose.tolist(),
            "rotation_deg": list(self.rotation_deg),
            "rotation_known": self.rotation_known,
            "reflectivity": self.reflectivity,
            "bounds_m": self.bounds_m.tolist(),
            "crop_m": self.crop_m.tolist(),
            "problems": list(self.mesh.problems),
        }


def file_sha256(item: TwinObject) -> str:
    """Digest of an object's mesh file; raises MeshError if it cannot be read."""
    try:
        return hashlib.sha256(item.path.read_bytes()).hexdigest()
    except OSError as error:
        raise MeshError("mesh.missing", f"{item.path}: cannot be read ({error.strerror})") from None


def resting_pose(
    vertices_m: NDArray[np.float64], rotation_deg: tuple[float, float, float], support_z_m: float
) -> NDArray[np.float64]:
    """The pose (4, 4) that turns an object and lays it on a plane, its bounding box centred at x = y = 0.

    Args:
        vertices_m: of the object, shape (V, 3).
        rotation_deg: about the fixed x, then y, then z axis.
        support_z_m: height of the plane.
    """
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler(
        "xyz", rotation_deg, degrees=True
    ).as_matrix()  # lower case: fixed axes
    turned = rotate(vertices_m, pose)
    low, high = turned.min(axis=0), turned.max(axis=0)
    pose[:3, 3] = [-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, support_z_m - low[2]]
    return pose
