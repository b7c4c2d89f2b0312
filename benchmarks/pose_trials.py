"""How well and how fast the pose of a known object is recovered, from a signal that another model made.

The measured signal sums every pair on another, finer tessellation with visibility per antenna, and has noise.
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scenes import report

from waveformer.simulator.forward import simulate
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.pose_recovery import recover_pose
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.rigid_pose import RigidPose
from waveformer.simulator.target import Target

MESHES = Path(__file__).resolve().parents[2] / "shared" / "meshes"
OBJECTS = ("ycb/035_power_drill", "ycb/025_mug", "ycb/051_large_clamp")
CHIRP = Chirp(start_hz=77e9, bandwidth_hz=3.6e9, num_samples=64)
APERTURE = Aperture.planar_grid(num_x=60, num_y=60, spacing_m=0.004)
EXACT = Numerics(spacing_wavelengths=0.22, facet_wavelengths=0.5, direct=True, tolerance=1e-5)
START_M, START_DEG = 0.005, 5.0
ALLOWED_M, ALLOWED_DEG = 0.2e-3, 0.3
# Upright, the middle of the bounding box below that of the aperture.
TRUTH = RigidPose(np.eye(3), np.array([0.0, 0.0, -0.4]))


def load(name: str) -> trimesh.Trimesh:
    return trimesh.load(MESHES / f"{name}.ply", process=False)


def measurement(name: str, folder: Path) -> Measurement:
    """The signal of one object, kept in `folder`: minutes at the first call."""
    path = folder / f"{name.replace('/', '-')}.zarr"
    if not path.exists():
        mesh = load(name)
        pose = TRUTH.matrix(mesh.bounds.mean(axis=0))
        target = Target(mesh.subdivide(), pose=pose)
        noise = FrontEnd(snr_db=20.0)
        simulate(target, CHIRP, APERTURE, front_end=noise, mode=EXACT, seed=0).save(path)
    return Measurement.load(path)


def start(rng: np.random.Generator) -> RigidPose:
    """5 mm and 5 degrees away in a random direction and about a random axis."""
    shift, turn = (direction / np.linalg.norm(direction) for direction in rng.normal(size=(2, 3)))
    return TRUTH.moved([*(START_M * shift), *(np.radians(START_DEG) * turn)])


def pose_trials(name: str, trials: int, seed: int, folder: Path) -> list[dict[str, Any]]:
    """Recover the pose of one object from random starts.

    Args:
        name: of a mesh of the shared collection, without suffix.
        trials: starts.
        seed: of the starts and of the searches.
        folder: keeps the measured signal.

    Returns:
        A row a start: errors in millimetres and degrees, wall-clock and processor seconds, and what the fit says.
    """
    mesh, measured = load(name), measurement(name, folder)
    middle = mesh.bounds.mean(axis=0)
    rng = generator(seed, f"pose trials {name}")
    rows = []
    for trial in range(trials):
        first = start(rng).matrix(middle)
        cpu = time.process_time()
        fit = recover_pose(
            measured.h,
            mesh.vertices,
            mesh.faces,
            measured.chirp,
            measured.aperture.tx_m,
            first,
            seed=seed + trial,
        )
        shift_m, turn_deg = RigidPose.of(fit.pose, middle).apart(TRUTH)
        rows.append(
            {
                "name": name,
                "error_mm": 1e3 * shift_m,
                "error_deg": turn_deg,
                "succeeded": shift_m <= ALLOWED_M and turn_deg <= ALLOWED_DEG,
                "agreed": fit.agreed,
                "searches": fit.runs,
                "misfit": fit.misfit,
                "wall_s": fit.seconds,
                "cpu_s": time.process_time() - cpu,
            }
        )
    return rows


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """One row an object: successes, largest errors, median seconds."""
    return {
        "name": rows[0]["name"],
        "trials": len(rows),
        "succeeded": sum(row["succeeded"] for row in rows),
        "largest_error_mm": max(row["error_mm"] for row in rows),
        "largest_error_deg": max(row["error_deg"] for row in rows),
        "median_wall_s": statistics.median(row["wall_s"] for row in rows),
        "median_cpu_s": statistics.median(row["cpu_s"] for row in rows),
    }


def main(folder: Path, trials: int) -> None:
    report([summary(pose_trials(name, trials, 0, folder)) for name in OBJECTS])


if __name__ == "__main__":
    main(Path(sys.argv[1]), 2 if "--quick" in sys.argv else 10)
