"""The test that decides where walls may change, against rays drawn at random."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.box_crossings import bounding_corners, leaving_changes, leaving_wall, meets_box
from waveformer.simulator.occluders import Box

BOX = Box((-0.08, -0.07, -0.42), (0.08, 0.07, -0.2), 0.004, "cardboard")
ANTENNAS = np.array([[-0.1, -0.12, 0.0], [0.15, 0.02, 0.0], [0.0, 0.1, 0.01]])
RADIUS_M = 0.006


def walls_by_walking(points: np.ndarray, antennas: np.ndarray) -> np.ndarray:
    """Walls crossed on straight ways, each way walked in small steps until it is outside: 2 axis + upper."""
    low, high = BOX.middle_min_m, BOX.middle_max_m
    place = points[:, None] + np.linspace(0.0, 1.0, 1001)[:, None] * (antennas - points)[:, None]
    beyond = np.stack([place < low, place > high], axis=-1).reshape(*place.shape[:2], 6)
    outside = beyond.any(axis=-1).argmax(axis=1)
    walls: np.ndarray = beyond[np.arange(len(points)), outside].argmax(axis=-1)
    return walls


def within_ball(rng: np.random.Generator, count: int) -> np.ndarray:
    direction = rng.normal(size=(count, 3))
    return RADIUS_M * rng.random((count, 1)) * direction / np.linalg.norm(direction, axis=1, keepdims=True)


def between_antennas(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform(ANTENNAS.min(axis=0), ANTENNAS.max(axis=0), (count, 3))


def test_the_wall_and_the_place_of_leaving(rng: np.random.Generator) -> None:
    points = rng.uniform((-0.07, -0.06, -0.41), (0.07, 0.06, -0.21), (300, 3))
    for antenna in ANTENNAS:
        walls, places = leaving_wall(BOX, points, antenna)
        walked = walls_by_walking(points, np.tile(antenna, (300, 1)))
        # a step of the walk may pass a corner
        assert (walls == walked).mean() > 0.97
        axis = walls // 2
        plane = np.where(walls % 2, BOX.middle_max_m[axis], BOX.middle_min_m[axis])
        np.testing.assert_allclose(places[np.arange(300), axis], plane, atol=1e-12)
        np.testing.assert_allclose(np.cross(places - points, antenna - points), 0.0, atol=1e-12)


def test_where_nothing_changes_all_rays_leave_by_one_wall(rng: np.random.Generator) -> None:
    centers = rng.uniform((-0.07, -0.06, -0.41), (0.07, 0.06, -0.21), (60, 3))
    changes = leaving_changes(BOX, centers, RADIUS_M, ANTENNAS)
    assert 5 < changes.sum() < 55
    for center, change in zip(centers, changes, strict=True):
        walls = walls_by_walking(center + within_ball(rng, 40), between_antennas(rng, 40))
        assert change or len(np.unique(walls)) == 1
    # and it does not cry wolf: below the lid's middle everything leaves upwards
    assert not leaving_changes(BOX, np.array([[0.0, 0.0, -0.22]]), RADIUS_M, ANTENNAS * [0.2, 0.2, 1.0]).any()


def test_a_way_along_a_wall_leaves_at_its_end() -> None:
    walls, places = leaving_wall(BOX, np.array([[0.0, 0.0, -0.3]]), np.array([0.0, 0.0, 0.0]))
    assert walls[0] == 5
    np.testing.assert_allclose(places, [[0.0, 0.0, BOX.middle_max_m[2]]])


def test_what_is_said_not_to_meet_the_box_does_not(rng: np.random.Generator) -> None:
    centers = np.concatenate(
        [rng.uniform((-0.4, -0.4, -0.7), (0.4, 0.4, -0.45), (60, 3)), rng.uniform((-0.4, -0.4, -0.15), (0.4, 0.4, -0.05), (60, 3))]
    )  # fmt: skip
    meets = meets_box(BOX, centers, RADIUS_M, ANTENNAS)
    # all below it may; beside and above it some do not
    assert meets[:60].any() and not meets[60:].any()
    low, high = BOX.middle_min_m, BOX.middle_max_m
    for center, meet in zip(centers, meets, strict=True):
        start, stop = center + within_ball(rng, 40), between_antennas(rng, 40)
        place = start[:, None] + np.linspace(0, 1, 400)[:, None] * (stop - start)[:, None]
        assert meet or not ((place > low) & (place < high)).all(axis=-1).any()


@pytest.mark.parametrize(
    ("positions", "count"), [([[1, 2, 3]], 1), ([[0, 0, 0], [1, 0, 2]], 4), (ANTENNAS, 8)]
)
def test_corners_of_a_bounding_box(positions: object, count: int) -> None:
    corners = bounding_corners(np.array(positions, dtype=float))
    assert corners.shape == (count, 3)
    np.testing.assert_array_equal(corners.min(axis=0), np.min(positions, axis=0))
    np.testing.assert_array_equal(corners.max(axis=0), np.max(positions, axis=0))
