"""Targets in the radar frame, and whether the radar can see them at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.occluders import Box
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.response_plan import Crossings
from waveformer.simulator.target import Target, rotate

# A surface nearer than this to an antenna lies in its reactive field, where k R is not large.
MIN_DISTANCE_WAVELENGTHS = 5.0
# What stands on the bottom of a box is inside it, whatever the last digits of its vertices say.
_ROUNDING_M = 1e-9


@dataclass(frozen=True)
class PlacedTarget:
    """A target in the radar frame.

    Attributes:
        mesh: its surface in mesh coordinates.
        material: of its surface.
        pose: from mesh coordinates to the radar frame, (4, 4).
        vertices_m: vertices in the radar frame, shape (V, 3).
        closest_m: lower bound of the distance between its bounding box and any antenna.
        crossings: walls of the box that ways to it cross.
    """

    mesh: SurfaceMesh
    material: Material
    pose: NDArray[np.float64]
    vertices_m: NDArray[np.float64]
    closest_m: float
    crossings: Crossings

    def describe(self, frequency_hz: float) -> dict[str, Any]:
        """JSON values for the metadata of a scan."""
        return {
            "name": self.mesh.name,
            "material": self.material.describe(frequency_hz),
            "bounds_m": [self.vertices_m.min(axis=0).tolist(), self.vertices_m.max(axis=0).tolist()],
            "pose": self.pose.tolist(),
            "two_sided": self.mesh.two_sided,
            "problems": list(self.mesh.problems),
        }


def place_target(target: Target, box: Box | None, chirp: Chirp, aperture: Aperture) -> PlacedTarget:
    """Load a target into the radar frame.

    Raises:
        MeshError: it cannot be used, touches or lies behind the aperture, or reaches through the box.
        RadarError: it lies beyond the unambiguous range.
    """
    mesh = target.mesh if isinstance(target.mesh, SurfaceMesh) else load_mesh(target.mesh)
    vertices = rotate(mesh.vertices_m, target.pose) + target.pose[:3, 3]
    closest_m = _distance(mesh.name, vertices, chirp, aperture)
    crossings = _crossings(mesh.name, vertices, box)
    return PlacedTarget(mesh, target.material, target.pose, vertices, closest_m, crossings)


def check_box(box: Box, chirp: Chirp, aperture: Aperture) -> float:
    """Distance of the closest antenna to a box; raises as `place_target` does."""
    return _distance("box", np.array([box.min_m, box.max_m]), chirp, aperture)


def _crossings(name: str, vertices: NDArray[np.float64], box: Box | None) -> Crossings:
    if box is None:
        return "none"
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    inner_low, inner_high = np.asarray(box.min_m) + box.thickness_m, np.asarray(box.max_m) - box.thickness_m
    if (low >= inner_low - _ROUNDING_M).all() and (high <= inner_high + _ROUNDING_M).all():
        return "leaving"
    if (low > np.asarray(box.max_m)).any() or (high < np.asarray(box.min_m)).any():
        return "any"
    raise MeshError(
        "mesh.through_box",
        f"{name}: {low.round(4).tolist()} .. {high.round(4).tolist()} m reaches through a wall of the box, whose "
        f"inside is {inner_low.round(4).tolist()} .. {inner_high.round(4).tolist()} m: use a larger box, or move it",
    )


def _distance(name: str, vertices: NDArray[np.float64], chirp: Chirp, aperture: Aperture) -> float:
    """Lower bound of the distance between a bounding box and any antenna; refuses what cannot be simulated."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    antennas = aperture.tx_m if aperture.rx_m is None else np.concatenate([aperture.tx_m, aperture.rx_m])
    lowest = float(antennas[:, 2].min())
    if high[2] >= lowest:
        side = "touches or reaches through" if low[2] < lowest else "lies behind"
        raise MeshError(
            "mesh.at_aperture",
            f"{name}: it (z {low[2]:.3f} .. {high[2]:.3f} m) {side} the aperture at z = {lowest:.3f} m, "
            "which looks down: move it below (pose, or --place 0 0 -0.4)",
        )
    outside = np.maximum(0.0, np.maximum(low - antennas, antennas - high))
    closest = float(np.sqrt((outside**2).sum(axis=1).min()))
    nearest_allowed = MIN_DISTANCE_WAVELENGTHS * float(chirp.wavelengths_m[0])
    if closest < nearest_allowed:
        raise MeshError(
            "mesh.at_aperture",
            f"{name}: {closest * 1e3:.1f} mm from an antenna is inside its reactive near field; "
            f"keep at least {nearest_allowed * 1e3:.0f} mm",
        )
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    farthest = max(float(np.linalg.norm(antennas - corner, axis=1).max()) for corner in corners)
    if farthest > chirp.unambiguous_range_m:
        raise RadarError(
            f"{name}: reaches {farthest:.2f} m from the radar, beyond the unambiguous range "
            f"{chirp.unambiguous_range_m:.2f} m of {chirp.num_samples} samples over {chirp.bandwidth_hz / 1e9:g} GHz: "
            "its echo would fold back; move it nearer or use more samples"
        )
    return closest
