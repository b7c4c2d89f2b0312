"""What the inverse problems are solved on: three everyday objects, and signals from a different discretisation.

Signals come from exact mode on a subdivided mesh with pieces of 0.22 wavelengths, so nothing that the fits use
(tessellation, visibility per tile, factorised kernel) made them. They are kept in a folder, since they take longer than
the fits.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from waveformer.simulator import Aperture, Chirp, FrontEnd, Material, Measurement, Target, load_mesh, simulate
from waveformer.simulator.numerics import EXACT

OBJECTS = {
    "power drill": "ycb/035_power_drill.ply",
    "mug": "ycb/025_mug.ply",
    "clamp": "ycb/051_large_clamp.ply",
}
CHIRP = Chirp(start_hz=77e9, bandwidth_hz=3.6e9, num_samples=64)
SNR_DB = 20.0
_TRUTH = EXACT.model_copy(update={"spacing_wavelengths": 0.22})


def placed(meshes: Path, name: str, height_m: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces of an object as it rests, its bounding box centred below the aperture's middle."""
    mesh = load_mesh(meshes / OBJECTS[name])
    middle = 0.5 * (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0))
    return mesh.vertices_m - middle + [0.0, 0.0, height_m], mesh.faces


def raster(num_x: int, num_y: int, spacing_x_m: float, spacing_y_m: float) -> NDArray[np.float64]:
    """Positions of a planar raster centred above the origin, (N, 3); rows along x."""
    x = (np.arange(num_x) - (num_x - 1) / 2) * spacing_x_m
    y = (np.arange(num_y) - (num_y - 1) / 2) * spacing_y_m
    return np.stack([*(axis.ravel() for axis in np.meshgrid(x, y)), np.zeros(num_x * num_y)], axis=1)


def measured(
    folder: Path,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    material: Material,
    aperture: Aperture,
    front_end: FrontEnd,
    seed: int,
) -> Measurement:
    """The signal that a fit is given, from the folder if it is there already."""
    key = hashlib.sha256()
    parts: tuple[Any, ...] = (
        vertices,
        faces,
        aperture.tx_m,
        aperture.receivers_m,
        material,
        front_end.describe(),
        seed,
    )
    for part in parts:
        key.update(part.tobytes() if isinstance(part, np.ndarray) else repr(part).encode())
    path = folder / f"{key.hexdigest()[:16]}.zarr"
    if path.exists():
        return Measurement.load(path)
    finer = trimesh.Trimesh(vertices, faces, process=False).subdivide()
    scan = simulate(Target(finer, material), CHIRP, aperture, mode=_TRUTH, front_end=front_end, seed=seed)
    folder.mkdir(parents=True, exist_ok=True)
    scan.save(path)
    return scan
