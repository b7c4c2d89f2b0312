"""Several unknowns at once: the pose of a known object, the range bias and the gain of the radar.

Coarse to fine over the aperture: tiles of 5 x 5 antennas with a free complex gain each see slopes of the wavefront
only, one free gain sees the whole wavefront but no level and no range, and the plain misfit sees all.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scenes import CHIRP, OBJECTS, SNR_DB, measured, placed, raster
from scipy.spatial.transform import Rotation

from waveformer.simulator import Aperture, FrontEnd, Material
from waveformer.simulator import differentiable as model
from waveformer.simulator.differentiable_rotation import rotation_matrix
from waveformer.simulator.least_squares import Stage, fit

TRIALS = 3
# Where the search for a pose ends: half a millimetre and half a degree.
START_M, START_DEG = 5e-4, 0.5
# A millimetre, and as much at 7 cm from the middle; bias in metres, gain in dB.
SCALES = (1e-3, 1e-3, 1e-3, 1.4e-2, 1.4e-2, 1.4e-2, 1e-3, 1.0)


def trials(meshes: Path, cache: Path, name: str, seed: int) -> list[dict[str, Any]]:
    """Errors of all starts on one object."""
    rng = np.random.default_rng([seed, list(OBJECTS).index(name)])
    vertices, faces = placed(meshes, name, -0.3)
    tx = raster(20, 20, 0.015, 0.015)
    bias_m, gain_db = rng.uniform(-5e-3, 5e-3), rng.uniform(-3.0, 3.0)
    front_end = FrontEnd(snr_db=SNR_DB, range_bias_m=bias_m)
    scan = measured(cache, vertices, faces, Material.pec(), Aperture(tx), front_end, seed)
    h = torch.from_numpy((scan.h * 10.0 ** (gain_db / 10.0)).astype(np.complex64))
    middle = torch.from_numpy(0.5 * (vertices.min(axis=0) + vertices.max(axis=0)))
    tiles = torch.from_numpy((np.arange(400) // 20 // 5) * 4 + (np.arange(400) % 20) // 5)
    stages = (Stage(tiles), Stage(torch.zeros(400, dtype=torch.int64)), Stage())
    rows: list[dict[str, Any]] = []
    for trial in range(TRIALS):
        shift, axis = rng.standard_normal(3), rng.standard_normal(3)
        shift *= START_M / np.linalg.norm(shift)
        turn = Rotation.from_rotvec(np.radians(START_DEG) * axis / np.linalg.norm(axis)).as_matrix()
        base = torch.from_numpy((vertices - middle.numpy()) @ turn.T + shift) + middle
        started = time.process_time()
        frozen = model.freeze(base, faces, CHIRP, tx)

        def echo(
            unknown: torch.Tensor, base: torch.Tensor = base, frozen: model.FrozenScene = frozen
        ) -> torch.Tensor:
            moved = (base - middle) @ rotation_matrix(unknown[3:6]).T + middle + unknown[:3]
            return model.simulate(
                moved, faces, CHIRP, tx, range_bias_m=unknown[6], antenna_gain_db=unknown[7], frozen=frozen
            )

        found = fit(
            echo, h, torch.zeros(8, dtype=torch.float64), torch.tensor(SCALES, dtype=torch.float64), stages
        )
        values = found.values.numpy()
        left = Rotation.from_rotvec(values[3:6]).as_matrix() @ turn
        rows.append(
            {
                "object": name,
                "trial": trial,
                "position_error_m": float(
                    np.linalg.norm(Rotation.from_rotvec(values[3:6]).apply(shift) + values[:3])
                ),
                "angle_error_deg": float(np.degrees(Rotation.from_matrix(left).magnitude())),
                "bias_error_m": float(values[6] - bias_m),
                "gain_error_db": float(values[7] - gain_db),
                "misfit": found.misfit,
                "history": found.history,
                "processor_seconds": time.process_time() - started,
            }
        )
        print(json.dumps(rows[-1]), flush=True)
    return rows


if __name__ == "__main__":
    meshes, cache, names = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:] or list(OBJECTS)
    for name in names:
        trials(meshes, cache, name, seed=1)
