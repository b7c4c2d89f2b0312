"""What a gradient misses because visibility is held: frozen against free, on the mug.

The loss is the misfit between the mug and the same mug moved by a few tenths of a millimetre. Its slope along the
six motions of a rigid body: once as the differentiable model gives it, once by central differences of exact mode, which
traces every ray anew for each displaced mug.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import torch
import trimesh
from numpy.typing import NDArray
from scenes import CHIRP, placed, raster
from scipy.spatial.transform import Rotation

from waveformer.simulator import Aperture, simulate
from waveformer.simulator import differentiable as model

# Phase of 0.07 rad: truncation below 1e-3, and many pieces change sides within a step.
_STEP_M, _STEP_RAD = 2e-5, 5e-4
_NAMES = ("shift x", "shift y", "shift z", "turn x", "turn y", "turn z")


def moved(vertices: NDArray[np.float64], motion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turned about the middle, then shifted; motion is shift in metres, then rotation vector."""
    middle = vertices.mean(axis=0)
    turned = (vertices - middle) @ Rotation.from_rotvec(motion[3:]).as_matrix().T
    return turned + middle + motion[:3]


def main(meshes: Path, name: str) -> None:
    vertices, faces = placed(meshes, name, -0.4)
    tx = raster(8, 8, 0.03, 0.03)

    def exact(motion: NDArray[np.float64]) -> NDArray[np.complex64]:
        mesh = trimesh.Trimesh(moved(vertices, motion), faces, process=False)
        return simulate(mesh, CHIRP, Aperture(tx), mode="exact").h

    target = exact(np.array([1e-4, -2e-4, 2e-4, 3e-3, 2e-3, -4e-3]))
    power = float((np.abs(target) ** 2).sum())

    def loss(h: NDArray[np.complex64]) -> float:
        return float((np.abs(h - target) ** 2).sum() / power)

    leaf = torch.tensor(vertices, requires_grad=True)
    h = model.simulate(leaf, faces, CHIRP, tx)
    ((h - torch.from_numpy(target)).abs() ** 2).sum().div(power).backward()
    gradient = leaf.grad.numpy()
    rows = []
    for place, name_of_motion in enumerate(_NAMES):
        step = (_STEP_M if place < 3 else _STEP_RAD) * np.eye(6)[place]
        size = float(step.sum())
        free = (loss(exact(step)) - loss(exact(-step))) / (2 * size)
        velocity = (moved(vertices, step) - moved(vertices, -step)) / (2 * size)
        frozen = float((gradient * velocity).sum())
        rows.append(
            {"motion": name_of_motion, "frozen": frozen, "free": free, "difference": frozen / free - 1}
        )
        print(json.dumps(rows[-1]), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "mug")
