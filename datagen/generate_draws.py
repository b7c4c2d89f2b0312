"""What one sample draws: pose, size, material, occluder and front end, each from a generator of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from waveformer.datagen.generate_settings import (
    FrontEndSettings,
    MaterialSettings,
    OccluderSettings,
    PlacementSettings,
)
from waveformer.datagen.resting_pose import resting_rotation
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Sheet


@dataclass(frozen=True)
class SampleSeed:
    """Random numbers of one view of one object, whatever its place in the dataset.

    Attributes:
        seed: of the dataset.
        object_id: of the object.
        view: number of the view.
    """

    seed: int
    object_id: str
    view: int

    def generator(self, purpose: str) -> np.random.Generator:
        """For one purpose; purposes share no numbers."""
        return generator(self.seed, f"{purpose} of {self.object_id}", self.view)

    def integer(self, purpose: str) -> int:
        """A seed for what takes one."""
        return int(self.generator(purpose).integers(2**31))


@dataclass(frozen=True, eq=False)
class Placement:
    """An object in the radar frame: x -> scale R x + t.

    Attributes:
        pose: rigid transform (4, 4), applied after the scale.
        scale: factor from the catalogue's metres.
        support_z_m: height of the plane on which the object rests.
    """

    pose: NDArray[np.float64]
    scale: float
    support_z_m: float

    def points(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the catalogue's frame in the radar frame, (P, 3)."""
        return np.asarray(self.scale * points_m @ self.pose[:3, :3].T + self.pose[:3, 3])

    def normals(self, normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Normals of the catalogue's frame in the radar frame, (P, 3)."""
        return np.asarray(normals @ self.pose[:3, :3].T)


def draw_placement(
    vertices_m: NDArray[np.float64], known_size: bool, settings: PlacementSettings, rng: np.random.Generator
) -> Placement:
    """A size and a pose in which the object rests on a plane below the aperture.

    Args:
        vertices_m: of the object, box centred at 0, (V, 3).
        known_size: whether its metres are true ones.
        settings: ranges.
        rng: of this sample.
    """
    low, high = settings.longest_side_m
    own_m = float(np.ptp(vertices_m, axis=0).max())
    wanted_m = (
        own_m * rng.uniform(*settings.size_jitter)
        if known_size
        else np.exp(rng.uniform(np.log(low), np.log(high)))
    )
    scale = float(np.clip(wanted_m, low, high)) / own_m
    rotation = _draw_rotation(vertices_m, settings.orientation, rng)
    turned = scale * vertices_m @ rotation.T
    bottom, top = turned.min(axis=0), turned.max(axis=0)
    support_z_m = min(
        float(rng.uniform(*settings.support_z_m)), -settings.least_depth_m - float(top[2] - bottom[2])
    )
    offset = rng.uniform(*settings.offset_m, 2) * rng.choice([-1.0, 1.0], 2)
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = [*(offset - 0.5 * (bottom + top)[:2]), support_z_m - bottom[2]]
    return Placement(pose, scale, support_z_m)


def draw_material(settings: MaterialSettings, rng: np.random.Generator) -> tuple[Material, float]:
    """A material, and the factor on the echo of a conductor."""
    roughness_m = float(rng.uniform(*settings.roughness_m))
    if rng.random() < settings.conductor_share:
        return Material.pec(roughness_m), float(rng.uniform(*settings.reflectivity))
    real, loss = rng.uniform(*settings.permittivity), rng.uniform(*settings.loss_tangent)
    return Material.dielectric(complex(real, -real * loss), roughness_m=roughness_m), 1.0


def draw_sheet(settings: OccluderSettings, top_z_m: float, rng: np.random.Generator) -> Sheet | None:
    """A sheet above an object whose top lies at top_z_m, or none."""
    if rng.random() >= settings.sheet_share:
        return None
    thickness_m = float(rng.uniform(*settings.thickness_m))
    face_z_m = top_z_m + float(rng.uniform(*settings.clearance_m)) + thickness_m
    tilt, around = np.deg2rad(rng.uniform(*settings.tilt_deg)), rng.uniform(0.0, 2.0 * np.pi)
    normal = [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)]
    material = settings.materials[int(rng.integers(len(settings.materials)))]
    return Sheet((0.0, 0.0, face_z_m), normal, thickness_m, material, echo=settings.echo)


def draw_front_end(settings: FrontEndSettings, rng: np.random.Generator) -> FrontEnd:
    """Noise, row errors and delay of a radar."""
    return FrontEnd(
        mirror_snr_db=float(rng.uniform(*settings.mirror_snr_db)),
        row_depth_error_m=float(rng.uniform(*settings.row_depth_error_m)),
        range_bias_m=float(rng.uniform(*settings.range_bias_m)),
    )


def _draw_rotation(
    vertices_m: NDArray[np.float64], orientation: str, rng: np.random.Generator
) -> NDArray[np.float64]:
    if orientation == "resting":
        return resting_rotation(vertices_m, rng)
    if orientation == "any":
        return np.asarray(Rotation.random(random_state=rng).as_matrix())
    return np.asarray(Rotation.from_euler("z", rng.uniform(0.0, 360.0), degrees=True).as_matrix())
