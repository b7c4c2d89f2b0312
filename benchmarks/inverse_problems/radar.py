"""Range bias, gain and row depths of a radar from one scan of a known object: ten random radars on each object."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scenes import CHIRP, OBJECTS, SNR_DB, measured, placed, raster

from waveformer.simulator import Aperture, FrontEnd, Material
from waveformer.simulator.calibration import calibrate, depth_model
from waveformer.simulator.front_end_positions import raster_rows, true_aperture

TRIALS = 10
# A calibration object stands near: how ways incline is all that tells the mean of the rows from the bias.
HEIGHT_M = -0.3
ROW_DEVIATION_M = 3e-4
LIMITS = {"bias_m": 5e-5, "gain_db": 0.05, "rows_m": 5e-5}


def trials(meshes: Path, cache: Path, name: str, seed: int) -> list[dict[str, Any]]:
    """Errors of all radars on one object."""
    rng = np.random.default_rng([seed, list(OBJECTS).index(name)])
    vertices, faces = placed(meshes, name, HEIGHT_M)
    aperture = Aperture(raster(24, 30, 0.0125, 0.01))
    rows_of_pairs = raster_rows(aperture)
    results: list[dict[str, Any]] = []
    for trial in range(TRIALS):
        bias_m, gain_db = rng.uniform(-0.03, 0.03), rng.uniform(-3.0, 3.0)
        front_end = FrontEnd(snr_db=SNR_DB, range_bias_m=bias_m, row_depth_error_m=ROW_DEVIATION_M)
        scan = measured(cache, vertices, faces, Material.pec(), aperture, front_end, trial)
        h = (scan.h * 10.0 ** (gain_db / 10.0)).astype(np.complex64)
        heights = true_aperture(front_end, aperture, trial).tx_m[:, 2]
        truth = np.array([heights[rows_of_pairs == row][0] for row in range(rows_of_pairs.max() + 1)])
        started = time.process_time()
        found = calibrate(h, rows_of_pairs, CHIRP, depth_model(vertices, faces, CHIRP, aperture.tx_m))
        results.append(
            {
                "object": name,
                "trial": trial,
                "bias_error_m": found.range_bias_m - bias_m,
                "gain_error_db": found.antenna_gain_db - gain_db,
                "rows_rms_m": float(np.sqrt(np.mean((found.row_depth_m - truth) ** 2))),
                "expected_bias_error_m": float(found.deviations_m[0]),
                "rows_true_m": truth.tolist(),
                "rows_found_m": found.row_depth_m.tolist(),
                "misfit": found.misfit,
                "processor_seconds": time.process_time() - started,
            }
        )
        row = results[-1]
        row["within_limits"] = bool(
            abs(row["bias_error_m"]) < LIMITS["bias_m"]
            and abs(row["gain_error_db"]) < LIMITS["gain_db"]
            and row["rows_rms_m"] < LIMITS["rows_m"]
        )
        print(json.dumps(results[-1]), flush=True)
    return results


if __name__ == "__main__":
    meshes, cache, names = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:] or list(OBJECTS)
    for name in names:
        trials(meshes, cache, name, seed=1)
