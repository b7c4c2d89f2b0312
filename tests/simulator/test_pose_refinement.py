"""The last steps of a pose by the differentiable model."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from waveformer.simulator.forward import simulate
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.rigid_pose import RigidPose
from waveformer.simulator.target import Target


@pytest.mark.usefixtures("mitsuba_variant")
def test_a_tenth_of_a_millimetre_and_degree_are_found() -> None:
    from waveformer.simulator.pose_body import Body
    from waveformer.simulator.pose_refinement import refine

    chirp, aperture = Chirp(77e9, 3.6e9, 16), Aperture.planar_grid(10, 10, 0.01)
    mesh = trimesh.creation.icosphere(subdivisions=3)
    x, y, z = mesh.vertices.T
    bumps = 1.0 + 0.15 * np.sin(4.0 * x + 1.0) * np.sin(3.0 * y) + 0.1 * np.sin(5.0 * z + 3.0 * x)
    mesh = trimesh.Trimesh(mesh.vertices * bumps[:, None] * [0.025, 0.018, 0.015], mesh.faces, process=False)
    body = Body(load_mesh(mesh), 0.0038)
    truth = RigidPose(np.eye(3), np.array([0.0, 0.0, -0.3])).moved([0, 0, 0, 0.2, -0.1, 0.4])
    target = Target(mesh, pose=truth.matrix(body.middle_m))
    h = simulate(target, chirp, aperture, mode=Numerics(spacing_wavelengths=0.3)).h
    near = truth.moved([6e-5, -5e-5, 6e-5, 1e-3, -1e-3, 1e-3])
    found, misfit = refine(body, near, h, chirp, aperture.tx_m)
    shift_m, turn_deg = found.apart(truth)
    # The other spacing changes the signal by 1.4 %: 2e-4 of its power, 4 um at 4 pi / lambda, and over a lever of
    # 2 cm 0.01 degrees. Twice that.
    assert misfit < 4e-4
    assert shift_m < 1e-5
    assert turn_deg < 0.02
