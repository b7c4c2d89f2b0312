"""What `waveformer simulate` can be told, by file and by flag, and the scene that follows from it."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from waveformer.config import Config
from waveformer.simulator.presets import APERTURE_PRESETS, CHIRP_PRESETS, lookup_preset

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from waveformer.simulator.mesh import SurfaceMesh
    from waveformer.simulator.target import Target

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
Unit = Literal["m", "cm", "mm", "in"]
Vector = tuple[float, float, float]


def _radar_preset(value: Any) -> Any:
    return lookup_preset("radar", CHIRP_PRESETS, value) if isinstance(value, str) else value


def _aperture_preset(value: Any) -> Any:
    if isinstance(value, str):
        return lookup_preset("aperture", APERTURE_PRESETS, value)
    if isinstance(value, dict):
        # Past this function the section is no JSON any more, and a tuple is only what is a tuple.
        return {key: tuple(item) if isinstance(item, list) else item for key, item in value.items()}
    return value


class ChirpConfig(Config):
    """The arguments of `Chirp`."""

    start_hz: float
    bandwidth_hz: float
    num_samples: int


class ApertureConfig(Config):
    """The arguments of `Aperture.planar_grid`."""

    num_x: int
    num_y: int
    spacing_m: float
    center_m: Vector = (0.0, 0.0, 0.0)


class SimulateConfig(Config):
    """One scan.

    Attributes:
        meshes: mesh files; they keep their places relative to each other.
        unit: length unit of the mesh files.
        place_m: the centre of their common bounding box goes there; None leaves them where they are.
        rotate_deg: turns about the fixed x, then y, then z axis through that centre, before placing.
        fix_winding: flip closed bodies that are turned inside out.
        radar: name of a preset, or start_hz, bandwidth_hz and num_samples.
        aperture: name of a preset, or num_x, num_y, spacing_m and center_m.
        mode: "fast", or "exact" (slow reference).
        tile_positions: most antenna positions in flight at once; bounds memory.
        threads: of the ray tracer; None = all cores.
        seed: recorded in the scan.
    """

    meshes: Annotated[tuple[str, ...], Field(min_length=1)]
    unit: Unit = "m"
    place_m: Vector | None = None
    rotate_deg: Vector = (0.0, 0.0, 0.0)
    fix_winding: bool = False
    radar: Annotated[ChirpConfig, BeforeValidator(_radar_preset)] = ChirpConfig(**CHIRP_PRESETS["mito"])
    aperture: Annotated[ApertureConfig, BeforeValidator(_aperture_preset)] = ApertureConfig(
        **APERTURE_PRESETS["small"]
    )
    mode: Literal["fast", "exact"] = "fast"
    tile_positions: Annotated[int, Field(ge=1)] | None = None
    threads: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0)] = 0


@dataclass(frozen=True)
class LoadedTargets:
    """Meshes ready to be simulated.

    Attributes:
        targets: with the pose applied by the simulator.
        records: per mesh where it came from, for the metadata of the scan.
        problems: what was repaired or is odd, one line each.
    """

    targets: list[Target]
    records: list[dict[str, Any]]
    problems: list[str]


def load_targets(config: SimulateConfig, folder: Path) -> LoadedTargets:
    """Read and place the meshes of a configuration.

    Args:
        config: what to load.
        folder: relative mesh paths start here.

    Raises:
        MeshError: a mesh cannot be used.
    """
    from waveformer.simulator.mesh import load_mesh
    from waveformer.simulator.target import Target

    paths = [(folder / mesh).absolute() for mesh in config.meshes]
    unit_m = UNITS_M[config.unit]
    meshes = [load_mesh(path, fix_winding=config.fix_winding, unit_m=unit_m) for path in paths]
    pose = scene_pose(meshes, config.place_m, config.rotate_deg)
    records = [
        {
            "path": str(path),
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            "unit_m": unit_m,
            "fix_winding": config.fix_winding,
            "pose": pose.tolist(),
        }
        for path in paths
    ]
    problems = [f"{mesh.name}: {problem}" for mesh in meshes for problem in mesh.problems]
    return LoadedTargets([Target(mesh, pose=pose) for mesh in meshes], records, problems)


def scene_pose(
    meshes: Sequence[SurfaceMesh], place_m: Vector | None, rotate_deg: Vector
) -> NDArray[np.float64]:
    """The rigid transform (4, 4) that turns meshes about the centre of their bounding box and places it.

    Args:
        meshes: treated as one rigid body.
        place_m: where the centre goes, metres in the radar frame; None leaves it.
        rotate_deg: turns about the fixed x, then y, then z axis.
    """
    import numpy as np
    from scipy.spatial.transform import Rotation

    low = np.min([mesh.vertices_m.min(axis=0) for mesh in meshes], axis=0)
    high = np.max([mesh.vertices_m.max(axis=0) for mesh in meshes], axis=0)
    center_m = (low + high) / 2
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", rotate_deg, degrees=True).as_matrix()  # lower case: fixed axes
    pose[:3, 3] = (center_m if place_m is None else np.asarray(place_m)) - pose[:3, :3] @ center_m
    return pose
