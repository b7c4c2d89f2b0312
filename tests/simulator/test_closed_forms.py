"""Closed forms against brute-force quadrature, against each other and against textbook levels."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from waveformer.simulator import closed_forms
from waveformer.simulator.closed_forms import (
    cylinder_far,
    cylinder_near_broadside,
    disc_far,
    disc_near_axis,
    disc_near_axis_paraxial,
    infinite_plane,
    plate_far,
    plate_near_axis_paraxial,
    point_scatterer,
    polygon_near,
    sphere_optics,
)
from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S

FREQUENCIES_HZ = np.array([77e9, 79e9, 81e9])
WAVELENGTHS_M = SPEED_OF_LIGHT_M_PER_S / FREQUENCIES_HZ


def rectangle(side_x_m, side_y_m):
    x, y = side_x_m / 2, side_y_m / 2
    return np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]])


def plate_by_midpoints(side_x_m, side_y_m, position_m, pieces_per_wavelength):
    """Physical-optics sum over small equal rectangles, the textbook way."""
    counts = [int(np.ceil(s / WAVELENGTHS_M.min() * pieces_per_wavelength)) for s in (side_x_m, side_y_m)]
    x, y = (((np.arange(n) + 0.5) / n - 0.5) * s for n, s in zip(counts, (side_x_m, side_y_m), strict=True))
    r = np.sqrt((position_m[0] - x) ** 2 + ((position_m[1] - y) ** 2)[:, None] + position_m[2] ** 2)
    weight = position_m[2] / r**3 * side_x_m * side_y_m / np.prod(counts)
    return np.array(
        [-1j / (4 * np.pi) * (weight * np.exp(-4j * np.pi * r / lam)).sum() for lam in WAVELENGTHS_M]
    )


@pytest.mark.parametrize(
    ("sides_m", "position_m"),
    [
        ((0.05, 0.05), (0.0, 0.0, 0.4)),
        ((0.02, 0.02), (0.0, 0.0, 0.4)),
        ((0.12, 0.05), (0.01, 0.02, 0.3)),
        ((0.05, 0.05), (0.025, 0.0, 0.4)),  # foot point on an edge
        ((0.05, 0.05), (0.0251, 0.025, 0.4)),  # just outside
        ((0.03, 0.03), (0.015, 0.015, 0.4)),  # on a corner
        ((0.05, 0.05), (0.08, 0.01, 0.4)),
        ((0.05, 0.05), (5.0, 0.0, 19.0)),
    ],
)
def test_polygon_equals_brute_force_quadrature(sides_m, position_m):
    position = np.array(position_m)
    exact = polygon_near(rectangle(*sides_m), position, FREQUENCIES_HZ)[0]
    brute = plate_by_midpoints(*sides_m, position, 40)
    mirror = np.abs(infinite_plane(np.linalg.norm(position), FREQUENCIES_HZ))
    assert (np.abs(exact - brute) < 3e-5 * mirror).all()


def test_polygon_edge_quadrature_is_converged(monkeypatch):
    rng = np.random.default_rng(3)
    antennas = np.column_stack([rng.uniform(-0.15, 0.15, (20, 2)), rng.uniform(0.2, 0.6, 20)])
    plain = polygon_near(rectangle(0.2, 0.05), antennas, FREQUENCIES_HZ)
    rule = closed_forms._unit_gauss_legendre
    monkeypatch.setattr(closed_forms, "_unit_gauss_legendre", lambda count: rule(2 * count))
    doubled = polygon_near(rectangle(0.2, 0.05), antennas, FREQUENCIES_HZ)
    assert np.abs(plain - doubled).max() < 1e-9 * np.abs(infinite_plane(0.4, 79e9))


def test_polygon_ignores_winding_side_pose_and_division():
    corners, antenna = rectangle(0.06, 0.04), np.array([[0.02, -0.01, 0.35]])
    h = polygon_near(corners, antenna, FREQUENCIES_HZ)
    assert_allclose(polygon_near(corners[::-1], antenna, FREQUENCIES_HZ), h, rtol=1e-9)
    assert_allclose(polygon_near(corners, antenna * [1, 1, -1], FREQUENCIES_HZ), h, rtol=1e-9)
    tilt = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    moved = polygon_near(corners @ tilt.T + 0.1, antenna @ tilt.T + 0.1, FREQUENCIES_HZ)
    assert_allclose(moved, h, rtol=1e-8)
    halves = polygon_near(corners[[0, 1, 2]], antenna, FREQUENCIES_HZ)
    halves = halves + polygon_near(corners[[0, 2, 3]], antenna, FREQUENCIES_HZ)
    assert_allclose(halves, h, rtol=1e-8)


def test_polygon_rejects_what_is_no_polygon():
    with pytest.raises(RadarError, match="one plane"):
        polygon_near([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.1]], [[0, 0, 1]], FREQUENCIES_HZ)
    with pytest.raises(RadarError, match="shape"):
        polygon_near([[0, 0], [1, 0], [0, 1]], [[0, 0, 1]], FREQUENCIES_HZ)
    with pytest.raises(RadarError, match="off the polygon"):
        polygon_near(rectangle(1, 1), [[0.2, 0, 0]], FREQUENCIES_HZ)


def test_regular_polygon_of_many_sides_is_the_disc():
    angle = 2 * np.pi * np.arange(1500) / 1500
    rim = 0.03 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    disc = disc_near_axis(0.03, 0.4, FREQUENCIES_HZ)
    assert_allclose(polygon_near(rim, [[0, 0, 0.4]], FREQUENCIES_HZ)[0], disc, rtol=1e-5)


def test_huge_disc_is_the_infinite_plane():
    """Physical optics of the plane exceeds the image by the obliquity factor's 1/(kd) only."""
    ratio = disc_near_axis(1e6, 0.4, FREQUENCIES_HZ) / infinite_plane(0.4, FREQUENCIES_HZ)
    assert (np.abs(ratio - 1) < 1.1 * WAVELENGTHS_M / (2 * np.pi * 0.4)).all()
    assert_allclose(np.abs(infinite_plane(0.4, 79e9)), SPEED_OF_LIGHT_M_PER_S / 79e9 / (8 * np.pi * 0.4))


@pytest.mark.parametrize(("side_m", "limit_db"), [(0.02, 0.01), (0.05, 0.02), (0.12, 0.2)])
def test_paraxial_plate_is_near_the_exact_one(side_m, limit_db):
    exact = polygon_near(rectangle(side_m, side_m), [[0, 0, 0.4]], FREQUENCIES_HZ)[0]
    paraxial = plate_near_axis_paraxial(side_m, side_m, 0.4, FREQUENCIES_HZ)
    assert np.abs(20 * np.log10(np.abs(paraxial / exact))).max() < limit_db


@pytest.mark.parametrize(
    ("side_m", "far_db", "mirror_db"), [(0.02, 0.1, 5.7), (0.05, 5.4, -5.0), (0.12, 23.3, -2.3)]
)
def test_near_plate_is_neither_far_field_nor_mirror(side_m, far_db, mirror_db):
    exact = np.abs(polygon_near(rectangle(side_m, side_m), [[0, 0, 0.4]], 79e9)[0, 0])
    assert_allclose(20 * np.log10(np.abs(plate_far(side_m, side_m, 0.4, 79e9)) / exact), far_db, atol=0.06)
    assert_allclose(20 * np.log10(np.abs(infinite_plane(0.4, 79e9)) / exact), mirror_db, atol=0.06)


def test_paraxial_disc_swings_from_nothing_to_twice_the_mirror():
    mirror = np.abs(infinite_plane(0.4, FREQUENCIES_HZ))
    for zones, level in ((1, 2.0), (2, 0.0), (3, 2.0)):
        # rim path longer by m half wavelengths per way and way back: k (R - d) = m pi / 2
        rim = 0.4 + zones * WAVELENGTHS_M / 4
        radius = np.sqrt(rim**2 - 0.4**2)
        h = np.abs(disc_near_axis_paraxial(radius, 0.4, FREQUENCIES_HZ))
        assert_allclose(h / mirror, level, atol=1e-8)
        assert_allclose(np.abs(disc_near_axis(radius, 0.4, FREQUENCIES_HZ)) / mirror, level, atol=0.02)


@pytest.mark.parametrize(
    ("h", "rcs_m2"),
    [
        (plate_far(0.05, 0.03, 50.0, FREQUENCIES_HZ), 4 * np.pi * (0.05 * 0.03) ** 2 / WAVELENGTHS_M**2),
        (disc_far(0.02, 50.0, FREQUENCIES_HZ), 4 * np.pi * (np.pi * 0.02**2) ** 2 / WAVELENGTHS_M**2),
        (cylinder_far(0.03, 0.1, 50.0, FREQUENCIES_HZ), 2 * np.pi / WAVELENGTHS_M * 0.03 * 0.1**2),
        (point_scatterer(0.01, 50.0, 50.0, FREQUENCIES_HZ), 0.01),
    ],
)
def test_textbook_radar_cross_sections(h, rcs_m2):
    measured = np.abs(h) ** 2 * (4 * np.pi) ** 3 * 50.0**4 / WAVELENGTHS_M**2
    assert_allclose(measured, np.broadcast_to(rcs_m2, 3), rtol=1e-9)


def test_near_forms_reach_their_far_field():
    near = sphere_optics(0.05, 1e5, FREQUENCIES_HZ)
    point = point_scatterer(np.pi * 0.05**2, 1e5, 1e5, FREQUENCIES_HZ)
    assert_allclose(np.abs(near), np.abs(point), rtol=1e-6)
    cylinder = cylinder_near_broadside(0.01, 0.05, 2e3 - 0.01, FREQUENCIES_HZ)
    assert_allclose(cylinder, cylinder_far(0.01, 0.05, 2e3, FREQUENCIES_HZ), rtol=2e-3)
    disc = disc_near_axis(0.02, 500.0, FREQUENCIES_HZ)
    assert_allclose(disc, disc_far(0.02, 500.0, FREQUENCIES_HZ), rtol=2e-3)


def test_far_plate_pattern_equals_the_edge_integral():
    angle = np.radians(np.linspace(0, 15, 31))
    antennas = 500.0 * np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    exact = polygon_near(rectangle(0.05, 0.05), antennas, FREQUENCIES_HZ)
    far = plate_far(0.05, 0.05, 500.0, FREQUENCIES_HZ, direction_x=np.sin(angle)[:, None])
    assert np.abs(exact - far).max() < 3e-3 * np.abs(far).max()


def test_disc_pattern_peak_is_finite():
    theta = np.radians([0.0, 1e-9, 5.0])
    h = np.abs(disc_far(0.03, 50.0, 79e9, theta_rad=theta))
    assert_allclose(h[1], h[0])
    assert h[2] < h[0]
