"""The angle of Eq. 2: a few sensors of a grid answer for all of them, and closed forms."""

import numpy as np
import pytest

from waveformer.datagen.specular_angles import specular_alignment, try_every_sensor
from waveformer.simulator import Aperture

# An angle near 0 comes from a cosine near 1, known to 1e-16: arccos makes 1.5e-8 rad of it.
ROUNDING_DEG = 1e-6


def directions(rng, count):
    found = rng.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def require_best(points_m, normals, sensors_m):
    """The same angles as the slow twin's, and sensors that have them."""
    found, slow = (search(points_m, normals, sensors_m) for search in (specular_alignment, try_every_sensor))
    np.testing.assert_allclose(found.angle_deg, slow.angle_deg, atol=ROUNDING_DEG)
    towards = sensors_m[found.sensor] - points_m
    cosine = np.einsum("pi,pi->p", towards, normals) / np.linalg.norm(towards, axis=1)
    np.testing.assert_allclose(np.rad2deg(np.arccos(cosine)), found.angle_deg, atol=ROUNDING_DEG)


@pytest.mark.parametrize("depth_m", [-0.45, -0.05, -0.002, 0.0, 0.3])
@pytest.mark.parametrize("counts", [(19, 26), (2, 40), (1, 9), (1, 1)])
def test_a_grid_as_if_every_sensor_were_tried(rng, depth_m, counts):
    sensors_m = Aperture.planar_grid(*counts, 0.016, center_m=(0.01, -0.02, 0.0)).tx_m
    points_m = rng.uniform(-1, 1, (1500, 3)) * [0.3, 0.3, 0.04] + [0, 0, depth_m + 1e-3]
    require_best(points_m, directions(rng, 1500), sensors_m)


def test_an_aperture_at_full_size(rng):
    sensors_m = Aperture.from_preset("mito").tx_m
    points_m = rng.uniform(-1, 1, (400, 3)) * [0.15, 0.15, 0.1] - [0, 0, 0.4]
    require_best(points_m, directions(rng, 400), sensors_m)


def test_rows_that_run_back_and_forth(rng):
    sensors_m = Aperture.raster_rows(0.3, 12, step_m=0.01, row_spacing_m=0.03).tx_m
    points_m = rng.uniform(-0.2, 0.2, (500, 3)) - [0, 0, 0.4]
    require_best(points_m, directions(rng, 500), sensors_m)


def test_sensors_anywhere(rng):
    require_best(rng.normal(size=(300, 3)) - [0, 0, 3], directions(rng, 300), rng.normal(size=(50, 3)))


def test_a_tilt_off_the_edge():
    # Straight below the middle of a 2 x 2 m square at 1 m: its rim is 45 degrees off, so a wall is 45 off the rim.
    sensors_m = Aperture.planar_grid(21, 21, 0.1).tx_m
    point_m = np.tile([0.0, 0.0, -1.0], (4, 1))
    tilt = np.deg2rad([0.0, 30.0, 90.0, 180.0])
    normals = np.stack([np.sin(tilt), 0 * tilt, np.cos(tilt)], axis=1)
    angle_deg = specular_alignment(point_m, normals, sensors_m).angle_deg
    # 30 degrees meet the plane between two sensors, 0.577 m out: the nearer one is at 0.6 m, atan 0.6 = 30.96 degrees.
    corner_deg = np.rad2deg(np.arccos(-1 / np.sqrt(3)))
    expected = [0.0, np.rad2deg(np.arctan(0.6)) - 30.0, 45.0, corner_deg]
    np.testing.assert_allclose(angle_deg, expected, atol=ROUNDING_DEG)


def test_no_points():
    found = specular_alignment(np.empty((0, 3)), np.empty((0, 3)), Aperture.planar_grid(3, 3, 0.1).tx_m)
    assert found.angle_deg.shape == found.sensor.shape == (0,)
