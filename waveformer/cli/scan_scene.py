"""The scene that a configuration describes: its meshes or scene file, loaded and placed."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waveformer.cli.matter_config import Vector
from waveformer.cli.scan_config import UNITS_M, SimulateConfig
from waveformer.simulator.errors import RadarError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from waveformer.simulator.mesh import SurfaceMesh
    from waveformer.simulator.occluders import Box, Sheet
    from waveformer.simulator.target import Target


@dataclass(frozen=True)
class LoadedSetup:
    """What stands before the radar.

    Attributes:
        targets: objects, with the pose applied by the simulator.
        sheets, box: occluders.
        origin: where the objects came from, for the metadata of the scan.
        problems: what was repaired or is odd, one line each.
    """

    targets: list[Target]
    sheets: list[Sheet]
    box: Box | None
    origin: dict[str, Any]
    problems: list[str]


def load_setup(config: SimulateConfig, folder: Path) -> LoadedSetup:
    """Read and place what a configuration describes.

    Args:
        config: what to load.
        folder: relative paths start here.

    Raises:
        MeshError: a mesh cannot be used.
        RadarError: the scene file, a material, a sheet or the box cannot be used.
    """
    import numpy as np

    setup = _from_scene_file(config, folder) if config.is_scene else _from_meshes(config, folder)
    sheets = [*(sheet.build() for sheet in config.sheets), *setup.sheets]
    if config.box is None:
        return replace(setup, sheets=sheets)
    if setup.box is not None:
        raise RadarError("both the scene file and the settings bring a box: leave one of them out")
    vertices = [mesh.vertices_m for mesh in placed_meshes(setup.targets)]
    bounds = np.array([np.min([v.min(0) for v in vertices], 0), np.max([v.max(0) for v in vertices], 0)])
    return replace(setup, sheets=sheets, box=config.box.build(bounds))


def placed_meshes(targets: Sequence[Target]) -> list[SurfaceMesh]:
    """The surfaces of targets in the radar frame; raises MeshError if one cannot be used."""
    return [in_radar_frame(as_surface(target), target.pose) for target in targets]


def as_surface(target: Target) -> SurfaceMesh:
    """The loaded mesh of a target; raises MeshError if it cannot be used."""
    from waveformer.simulator.mesh import SurfaceMesh, load_mesh

    return target.mesh if isinstance(target.mesh, SurfaceMesh) else load_mesh(target.mesh)


def in_radar_frame(mesh: SurfaceMesh, pose: NDArray[np.float64]) -> SurfaceMesh:
    """The mesh moved by a rigid pose (4, 4)."""
    return replace(mesh, vertices_m=mesh.vertices_m @ pose[:3, :3].T + pose[:3, 3])


def geometry_sha256(meshes: Sequence[SurfaceMesh]) -> str:
    """One digest of all vertices and faces."""
    digest = hashlib.sha256()
    for mesh in meshes:
        digest.update(mesh.vertices_m.tobytes() + mesh.faces.tobytes())
    return digest.hexdigest()


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


def _from_scene_file(config: SimulateConfig, folder: Path) -> LoadedSetup:
    from waveformer.simulator.scene_file import load_scene

    path = (folder / config.meshes[0]).absolute()
    scene = load_scene(path)
    if not scene.targets:
        raise RadarError(
            f"{path}: the scene has no object, only sheets or a box: add a shape with radar_specular"
        )
    # read here once, not again by whoever asks for their bounds or sums them
    targets = [replace(target, mesh=as_surface(target)) for target in scene.targets]
    meshes = placed_meshes(targets)
    origin = {"meshes": [], "scene": {"path": str(path), "geometry_sha256": geometry_sha256(meshes)}}
    return LoadedSetup(targets, scene.sheets, scene.box, origin, _problems(meshes))


def _from_meshes(config: SimulateConfig, folder: Path) -> LoadedSetup:
    from waveformer.simulator.mesh import load_mesh
    from waveformer.simulator.target import Target

    material = config.material.build()
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
    targets = [Target(mesh, material, pose) for mesh in meshes]
    return LoadedSetup(targets, [], None, {"meshes": records}, _problems(meshes))


def _problems(meshes: Sequence[SurfaceMesh]) -> list[str]:
    return [f"{mesh.name}: {problem}" for mesh in meshes for problem in mesh.problems]
