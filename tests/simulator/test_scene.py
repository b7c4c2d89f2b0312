"""Rays between samples and antennas: two plates, one in the shadow of the other, against plain geometry."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives, scene
from waveformer.simulator.scene import BACK_FACING, BLOCKED, VISIBLE, SampleTable, build_scene, sample_states

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

UPPER_Z, LOWER_Z, HALF_SIDE_M = -0.15, -0.5, 0.05
ANTENNAS = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.0, -0.05, 0.0]])
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def two_plates(mitsuba_variant: str) -> Any:
    """A plate of 10 cm 35 cm above a plate of 60 cm."""
    upper = primitives.plate(2 * HALF_SIDE_M, 2 * HALF_SIDE_M, center_m=(0, 0, UPPER_Z))
    lower = primitives.plate(0.6, 0.6, center_m=(0, 0, LOWER_Z))
    return build_scene([(mesh.vertices, mesh.faces) for mesh in (upper, lower)])


def lower_points(rng: np.random.Generator, count: int = 2000) -> np.ndarray:
    points = np.full((count, 3), LOWER_Z)
    points[:, :2] = rng.uniform(-0.3, 0.3, (count, 2))
    return points


def crossing(points: np.ndarray, antenna: np.ndarray) -> np.ndarray:
    """Where the line of sight passes the plane of the upper plate: largest |x|, |y|."""
    fraction = (UPPER_Z - points[:, 2]) / (antenna[2] - points[:, 2])
    return np.abs(points + fraction[:, None] * (antenna - points))[:, :2].max(axis=1)


def test_the_shadow_of_a_plate_lies_where_geometry_puts_it(rng: np.random.Generator, two_plates: Any) -> None:
    points = lower_points(rng)
    states = sample_states(
        two_plates, SampleTable(points, np.tile(UP, (len(points), 1))), False, ANTENNAS, None
    )
    assert states.shape == (3, len(points))
    for row, antenna in enumerate(ANTENNAS):
        through = crossing(points, antenna)
        # rays start 0.1 mm above the surface, which moves the shadow's edge by less
        certain = np.abs(through - HALF_SIDE_M) > 2e-4
        expected = np.where(through < HALF_SIDE_M, BLOCKED, VISIBLE)
        assert (states[row] == expected)[certain].all()
        assert (states[row] == BLOCKED).any()
        assert certain.mean() > 0.98


def test_what_lies_behind_an_antenna_does_not_block(rng: np.random.Generator) -> None:
    roof = primitives.plate(2.0, 2.0, center_m=(0, 0, 0.001))
    points = lower_points(rng, 300)
    scene_below_roof = build_scene([(roof.vertices, roof.faces)])
    states = sample_states(
        scene_below_roof, SampleTable(points, np.tile(UP, (300, 1))), False, ANTENNAS, None
    )
    assert (states == VISIBLE).all()


def test_a_pair_is_blocked_if_either_way_is(rng: np.random.Generator, two_plates: Any) -> None:
    points = lower_points(rng)
    tx_m, rx_m = ANTENNAS[:1], ANTENNAS[1:2]
    states = sample_states(two_plates, SampleTable(points, np.tile(UP, (len(points), 1))), False, tx_m, rx_m)[
        0
    ]
    distances = [crossing(points, antenna[0]) for antenna in (tx_m, rx_m)]
    certain = np.all([np.abs(through - HALF_SIDE_M) > 2e-4 for through in distances], axis=0)
    free = np.all([through > HALF_SIDE_M for through in distances], axis=0)
    assert (states == np.where(free, VISIBLE, BLOCKED))[certain].all()


def test_the_upper_plate_does_not_shadow_itself(rng: np.random.Generator, two_plates: Any) -> None:
    points = lower_points(rng, 500) * [0.16, 0.16, 0] + [0, 0, UPPER_Z]
    states = sample_states(two_plates, SampleTable(points, np.tile(UP, (500, 1))), False, ANTENNAS, None)
    assert (states == VISIBLE).all()


def test_a_one_sided_sample_that_faces_away_is_never_seen(two_plates: Any) -> None:
    points = np.array([[0.0, 0.0, UPPER_Z], [0.2, 0.2, LOWER_Z], [0.0, 0.0, LOWER_Z]])
    states = sample_states(two_plates, SampleTable(points, np.tile(-UP, (3, 1))), False, ANTENNAS[:1], None)
    assert states.tolist() == [[BACK_FACING] * 3]


def test_a_two_sided_sample_is_seen_whichever_way_its_normal_points(two_plates: Any) -> None:
    points = np.array([[0.0, 0.0, UPPER_Z], [0.2, 0.2, LOWER_Z], [0.0, 0.0, LOWER_Z]])
    for normal in (UP, -UP):
        states = sample_states(
            two_plates, SampleTable(points, np.tile(normal, (3, 1))), True, ANTENNAS[:1], None
        )
        assert states.tolist() == [[VISIBLE, VISIBLE, BLOCKED]]


def test_transmitter_and_receiver_on_opposite_sides_do_not_see_a_two_sided_sample(two_plates: Any) -> None:
    points = np.array([[0.04, 0.04, UPPER_Z]])
    above, below = np.array([[0.0, 0.0, 0.0]]), np.array([[0.04, 0.04, -0.45]])
    for normal in (UP, -UP):
        assert sample_states(two_plates, SampleTable(points, normal[None]), True, above, below) == BACK_FACING
        assert sample_states(two_plates, SampleTable(points, normal[None]), True, below, above) == BACK_FACING
        assert sample_states(two_plates, SampleTable(points, normal[None]), True, below, below) == VISIBLE


def test_chosen_pairs_give_the_states_of_all_pairs(rng: np.random.Generator, two_plates: Any) -> None:
    points = lower_points(rng, 300)
    normals = np.tile(UP, (300, 1))
    for receivers in (None, ANTENNAS + 0.01):
        everything = sample_states(two_plates, SampleTable(points, normals), False, ANTENNAS, receivers)
        pairs = rng.integers(3, size=700), rng.integers(300, size=700)  # (position, sample)
        chosen = sample_states(
            two_plates, SampleTable(points, normals), False, ANTENNAS, receivers, pairs=pairs
        )
        assert (chosen == everything[pairs]).all()


def test_no_sample_or_no_antenna_means_no_state(two_plates: Any) -> None:
    nothing, one = np.empty((0, 3)), np.array([[0.0, 0.0, LOWER_Z]])
    assert sample_states(two_plates, SampleTable(nothing, nothing), False, ANTENNAS, None).shape == (3, 0)
    assert sample_states(two_plates, SampleTable(one, UP[None]), False, nothing, None).shape == (0, 1)


@pytest.mark.parametrize("lanes", [1, 650])
def test_the_size_of_a_launch_does_not_show(
    rng: np.random.Generator, two_plates: Any, monkeypatch: pytest.MonkeyPatch, lanes: int
) -> None:
    points = lower_points(rng, 300)
    normals = np.tile(UP, (300, 1))
    for receivers in (None, ANTENNAS + 0.01):
        monkeypatch.undo()
        whole = sample_states(two_plates, SampleTable(points, normals), False, ANTENNAS, receivers)
        monkeypatch.setattr(scene, "_LANES_PER_LAUNCH", lanes)
        parts = sample_states(two_plates, SampleTable(points, normals), False, ANTENNAS, receivers)
        assert (parts == whole).all()
