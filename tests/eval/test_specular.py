"""The specular share of a surface against closed forms."""

import numpy as np
import pytest
import trimesh

from waveformer.eval.specular import bright_fraction, specular_fraction
from waveformer.simulator.grid import Grid
from waveformer.simulator.image import Image
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.radar import Aperture

ONE_ANTENNA = Aperture(np.zeros((1, 3)))


def test_sphere_shows_a_cap():
    radius_m, distance_m, tolerance_deg = 0.05, 50.0, 20.0
    ball = trimesh.creation.icosphere(subdivisions=6, radius=radius_m).apply_translation((0, 0, -distance_m))
    # Far away, the normal within t of the antenna cuts a cap of (1 - cos t) / 2 of the sphere: 3.02 %.
    expected = (1 - np.cos(np.deg2rad(tolerance_deg))) / 2
    assert specular_fraction(load_mesh(ball), ONE_ANTENNA, tolerance_deg) == pytest.approx(expected, rel=0.02)


def test_both_sides_of_a_sheet_count():
    corners = [(-0.01, -0.01, -1), (0.01, -0.01, -1), (0.01, 0.01, -1), (-0.01, 0.01, -1)]
    sheet = load_mesh(trimesh.Trimesh(corners, [(0, 2, 1), (0, 3, 2)], process=False))  # normals down
    assert specular_fraction(sheet, ONE_ANTENNA, 5.0) == 1.0


def test_bright_share_of_a_box():
    box = load_mesh(trimesh.creation.box((0.1, 0.1, 0.1)).subdivide().subdivide())
    grid = Grid.box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1), 0.01)
    values = np.zeros(grid.shape, np.complex64)
    values[:, :, grid.z > 0.045] = 1.0
    # The top face of six; the sides end 1 mm into the linear slope below it.
    assert bright_fraction(box, Image(values, grid), -3.0) == pytest.approx(1 / 6, abs=0.001)
    assert bright_fraction(box, Image(0 * values, grid), -3.0) == 0.0
