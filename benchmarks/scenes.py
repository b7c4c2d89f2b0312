"""What every benchmark measures on: the radar, the object, and how a time is taken."""

from __future__ import annotations

import gc
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import trimesh

from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.quadrature import faces_that_can_face, sample_surface
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.runtime import activate

CHIRP = Chirp(start_hz=77.5001e9, bandwidth_hz=3.0009e9, num_samples=256)
APERTURE = Aperture.planar_grid(num_x=60, num_y=60, spacing_m=0.003)
TOP_Z_M = -0.28
EXTENT_M = 0.2


def bumpy_ellipsoid() -> SurfaceMesh:
    """A smooth object 20 cm long, 81,920 faces, its top 28 cm below the middle of the aperture.

    Dents and bumps 4 to 12 cm wide make it shine in several places and shadow itself at the rim.
    """
    mesh = trimesh.creation.icosphere(subdivisions=6)
    x, y, z = mesh.vertices.T
    bumps = np.sin(5.0 * x + 1.0) * np.sin(4.0 * y) + 0.7 * np.sin(7.0 * z + 3.0 * x) + 0.5 * np.sin(9.0 * y)
    points = mesh.vertices * (1.0 + 0.08 * bumps)[:, None] * [1.0, 0.75, 0.55]
    points *= EXTENT_M / np.ptp(points, axis=0).max()
    points -= 0.5 * (points.min(axis=0) + points.max(axis=0))
    points[:, 2] += TOP_Z_M - points[:, 2].max()
    return load_mesh(trimesh.Trimesh(points, mesh.faces, process=False))


class Surface:
    """A mesh traced and sampled as `simulate` does it: what the kernels start from."""

    def __init__(self, mesh: SurfaceMesh, numerics: Numerics) -> None:
        activate()
        from waveformer.simulator.scene import build_scene

        self.mesh = mesh
        self.scene = build_scene([(mesh.vertices_m, mesh.faces)])
        faces_m = mesh.vertices_m[mesh.faces]
        keep = faces_that_can_face(faces_m, mesh.normals, False, APERTURE.tx_m, APERTURE.receivers_m)
        spacing_m = numerics.spacing_wavelengths * SPEED_OF_LIGHT_M_PER_S / CHIRP.center_hz
        self.samples = sample_surface(mesh, np.eye(4), spacing_m, keep)
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        outside = np.maximum(0.0, np.maximum(low - APERTURE.tx_m, APERTURE.tx_m - high))
        self.closest_m = float(np.linalg.norm(outside, axis=1).min())


@dataclass(frozen=True)
class Timing:
    """Seconds of repeated runs: wall clock, and processor time of the whole process."""

    wall_s: list[float]
    cpu_s: list[float]

    def rate(self, pairs: float) -> dict[str, Any]:
        """Pairs per second from medians, and the range over the runs."""
        rates = sorted(pairs / seconds for seconds in self.cpu_s)
        return {
            "pairs": int(pairs),
            "runs": len(rates),
            "pairs_per_cpu_s": pairs / statistics.median(self.cpu_s),
            "pairs_per_wall_s": pairs / statistics.median(self.wall_s),
            "lowest_per_cpu_s": rates[0],
            "highest_per_cpu_s": rates[-1],
        }


def measure(work: Callable[[], Any], runs: int) -> Timing:
    """Time `work` after one run that is thrown away, which compiles kernels and fills caches."""
    work()
    wall_s, cpu_s = [], []
    for _ in range(runs):
        gc.collect()
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        cpu_s.append(time.process_time() - cpu)
        wall_s.append(time.perf_counter() - wall)
    return Timing(wall_s, cpu_s)


def relative_l2(values: Any, reference: Any) -> float:
    """Norm of the difference over the norm of the reference."""
    return float(np.linalg.norm(np.asarray(values) - reference) / np.linalg.norm(reference))


def report(rows: list[dict[str, Any]]) -> None:
    """Hand the rows to `run.py`: one line of JSON, the last of the output."""
    print(json.dumps(rows))
