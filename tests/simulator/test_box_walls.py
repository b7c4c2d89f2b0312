"""The rectangles of a box's walls: where they lie, how much area they have, and which faces are left out."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.box_walls import wall_pieces
from waveformer.simulator.occluders import Box

BOX = Box((-0.06, -0.07, -0.5), (0.06, 0.07, -0.3), 0.005, "cardboard")
AROUND = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-2.0, 1.0)])
SIDES = np.array([0.12, 0.14, 0.2])


@pytest.mark.parametrize("inside", [False, True])
def test_six_faces_of_full_area(inside: bool) -> None:
    samples, edges = wall_pieces(BOX, 0.004, AROUND, inside=inside)
    sides = SIDES - (0.01 if inside else 0.0)
    assert (edges <= 0.004).all()
    for axis in range(3):
        first, second = (other for other in range(3) if other != axis)
        for sign in (-1.0, 1.0):
            face = samples.normals[:, axis] == sign
            assert samples.areas_m2[face].sum() == pytest.approx(sides[first] * sides[second], rel=1e-12)
            # the centroid of a face is its middle
            middle = (np.asarray(BOX.min_m) + BOX.max_m) / 2
            middle[axis] += (-sign if inside else sign) * sides[axis] / 2
            np.testing.assert_allclose(samples.points_m[face].mean(axis=0), middle, atol=1e-12)
    assert samples.areas_m2.sum() == pytest.approx(
        2 * (sides[0] * sides[1] + sides[1] * sides[2] + sides[0] * sides[2]), rel=1e-12
    )
    np.testing.assert_array_equal(np.linalg.norm(samples.normals, axis=1), 1.0)


def test_every_piece_is_a_rectangle_with_the_given_edges() -> None:
    samples, edges = wall_pieces(BOX, 0.01, AROUND, inside=False)
    for axis in range(3):
        first, second = (other for other in range(3) if other != axis)
        across = np.abs(samples.normals[:, axis]) == 1.0
        np.testing.assert_allclose(samples.areas_m2[across], edges[first] * edges[second], rtol=1e-12)


def test_from_above_only_the_lid_shows_outside_and_all_but_the_lid_inside() -> None:
    above = np.array([[0.01, 0.02, 0.0], [-0.03, 0.0, 0.0]])
    outside, _ = wall_pieces(BOX, 0.01, above, inside=False)
    np.testing.assert_array_equal(np.unique(outside.normals, axis=0), [[0.0, 0.0, 1.0]])
    np.testing.assert_allclose(outside.points_m[:, 2], -0.3)
    within, _ = wall_pieces(BOX, 0.01, above, inside=True)
    assert {tuple(normal) for normal in within.normals} == {
        (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0),
    }  # fmt: skip
    assert within.points_m[within.normals[:, 2] == 1.0, 2] == pytest.approx(-0.495)


def test_a_side_shows_as_soon_as_one_antenna_lies_beyond_it() -> None:
    beside = np.array([[0.0, 0.0, 0.0], [0.0601, 0.0, 0.0]])
    outside, _ = wall_pieces(BOX, 0.01, beside, inside=False)
    assert {tuple(normal) for normal in outside.normals} == {(0.0, 0.0, 1.0), (1.0, 0.0, 0.0)}


def test_no_face_is_seen_from_within_its_own_plane() -> None:
    samples, _ = wall_pieces(BOX, 0.01, np.array([[0.0, 0.0, -0.3]]), inside=False)
    assert len(samples.points_m) == 0
