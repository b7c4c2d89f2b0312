"""Eq. 3: the tilt from boresight, and what the printed sentence would do."""

import numpy as np
import pytest

from waveformer.datagen.specular_tilt import literal_angles_deg, tilt_deg

FACING = np.array([[0.0, 0.0, 1.0]])


def turned(degrees, axis):
    angle = np.deg2rad(degrees)
    normal = np.zeros((1, 3))
    normal[0, axis], normal[0, 2] = np.sin(angle), np.cos(angle)
    return normal


@pytest.mark.parametrize("degrees", [-60.0, 25.0, 90.0, 150.0])
def test_tilts_in_their_planes(degrees):
    assert np.ravel(tilt_deg(turned(degrees, 0))) == pytest.approx(
        [abs(degrees), 0.0 if abs(degrees) < 90.1 else 180.0], abs=1e-9
    )
    assert tilt_deg(turned(degrees, 1))[1] == pytest.approx(abs(degrees))


def test_a_surface_that_faces_the_radar():
    assert np.ravel(tilt_deg(FACING)).tolist() == [0.0, 0.0]
    assert np.ravel(literal_angles_deg(FACING)).tolist() == [90.0, 90.0]


def test_the_literal_reading_keeps_nothing_below_45_degrees(rng):
    normals = rng.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    horizontal, vertical = literal_angles_deg(normals)
    assert not ((horizontal < 45) & (vertical < 45)).any()
    # cos^2 + cos^2 <= 1: between both axes is the nearest a direction comes to both.
    assert np.ravel(literal_angles_deg(np.array([[1.0, 1.0, 0.0]]) / np.sqrt(2))) == pytest.approx([45, 45])
