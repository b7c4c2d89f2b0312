"""The picture of a pose recovery."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from waveformer.eval.pose_figure import pose_figure
from waveformer.simulator.forward import simulate
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.pose_recovery import PoseFit, PoseStep
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.target import Target


def pose(x_m: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = [x_m, 0.0, -0.3]
    return matrix


@pytest.mark.usefixtures("mitsuba_variant")
def test_the_picture_shows_where_the_object_was_thought_to_be(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.04, 0.03, 0.02))
    scan = simulate(Target(box, pose=pose(0.0)), Chirp(77e9, 3.6e9, 16), Aperture.planar_grid(8, 8, 0.01))

    def picture(start_m: float, found_m: float, true_m: float) -> np.ndarray:
        steps = tuple(PoseStep(name, pose(x_m), 0.1) for name, x_m in (("search", 0.002), ("last", found_m)))
        fit = PoseFit(steps[-1].pose, 0.1, True, 2, 1.0, steps)
        pose_figure(fit, load_mesh(box), scan, pose(start_m), pose(true_m), tmp_path / "pose.png")
        return np.asarray(imread(tmp_path / "pose.png"))

    first = picture(0.01, 0.0, 0.0)
    assert first.shape[0] > 500
    upper = slice(0, first.shape[0] // 2), slice(0, 2 * first.shape[1] // 3)  # the outlines
    for other in ((0.015, 0.0, 0.0), (0.01, 0.004, 0.0), (0.01, 0.0, 0.004)):
        assert (picture(*other)[upper] != first[upper]).any()
