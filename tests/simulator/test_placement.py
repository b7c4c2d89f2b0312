"""Targets in the radar frame: where they may stand, which walls their ways cross, what is refused."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Box
from waveformer.simulator.placement import MIN_DISTANCE_WAVELENGTHS, check_box, place_target
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.target import Target

CHIRP = Chirp(77.5001e9, 3.0009e9, 64)
APERTURE = Aperture([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
BOX = Box((-0.08, -0.07, -0.42), (0.08, 0.07, -0.2), 0.004, "cardboard")


def cube(center: Any = (0.0, 0.0, -0.3), edge_m: float = 0.04, turn: Any = None) -> Target:
    mesh = primitives.plate(edge_m, edge_m) + primitives.plate(edge_m, edge_m).apply_translation(
        [0, 0, edge_m]
    )
    mesh.apply_translation([0, 0, -edge_m / 2])
    pose = np.eye(4)
    pose[:3, 3] = center
    if turn is not None:
        pose[:3, :3] = turn
    return Target(mesh, Material.named("abs"), pose)


def test_vertices_are_in_the_radar_frame() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    target = cube((0.01, 0.02, -0.3), turn=turn)
    placed = place_target(target, None, CHIRP, APERTURE)
    expected = np.asarray(target.mesh.vertices) @ turn.T + [0.01, 0.02, -0.3]  # type: ignore[union-attr]
    assert {tuple(v) for v in placed.vertices_m.round(9)} == {tuple(v) for v in expected.round(9)}
    assert placed.material == Material.named("abs")


def test_the_closest_distance_is_to_the_bounding_box() -> None:
    # the second antenna looks past the edge at x = 0.02: 8 cm aside, 28 cm down
    far = Aperture([[0.1, 0.0, 0.0]])
    assert place_target(cube(), None, CHIRP, APERTURE).closest_m == pytest.approx(0.28)
    assert place_target(cube(), None, CHIRP, far).closest_m == pytest.approx(np.hypot(0.08, 0.28))
    # receivers count as well
    pair = Aperture(far.tx_m, [[0.0, 0.0, 0.0]])
    assert place_target(cube(), None, CHIRP, pair).closest_m == pytest.approx(0.28)
    assert check_box(BOX, CHIRP, APERTURE) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("box", "center", "crossings"),
    [
        (None, (0, 0, -0.3), "none"),
        (BOX, (0, 0, -0.3), "leaving"),
        (BOX, (0, 0, -0.46), "any"),
        (BOX, (0.12, 0, -0.3), "any"),
        (BOX, (0, 0, -0.15), "any"),
        # it may stand on the bottom and touch the sides, but for rounding
        (BOX, (0.056, 0.046, -0.396), "leaving"),
    ],
)
def test_which_walls_are_crossed(box: Box | None, center: Any, crossings: str) -> None:
    assert place_target(cube(np.array(center, float)), box, CHIRP, APERTURE).crossings == crossings


@pytest.mark.parametrize(
    "center", [(0.058, 0, -0.3), (0, 0, -0.2), (0, 0, -0.4), (0, -0.07, -0.3), (0, 0, -0.41)]
)
def test_what_reaches_through_a_wall_is_refused(center: Any) -> None:
    with pytest.raises(MeshError, match="reaches through a wall of the box"):
        place_target(cube(center), BOX, CHIRP, APERTURE)


@pytest.mark.parametrize(
    ("center", "told"),
    [
        ((0, 0, 0), "touches or reaches through"),
        ((0, 0, 0.5), "lies behind"),
        ((0, 0, -0.03), "reactive near field"),
    ],
)
def test_what_the_radar_cannot_see_is_refused(center: Any, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        place_target(cube(center), None, CHIRP, APERTURE)


def test_the_reactive_near_field_ends_at_five_wavelengths() -> None:
    nearest = MIN_DISTANCE_WAVELENGTHS * CHIRP.wavelengths_m[0]
    place_target(cube((0, 0, -0.02 - nearest - 1e-6)), None, CHIRP, APERTURE)
    with pytest.raises(MeshError, match="reactive"):
        place_target(cube((0, 0, -0.02 - nearest + 1e-6)), None, CHIRP, APERTURE)


def test_the_unambiguous_range_is_kept() -> None:
    short = Chirp(77.5e9, 3e9, 8)  # 0.4 m
    place_target(cube((0, 0, -0.35)), None, short, APERTURE)
    with pytest.raises(RadarError, match="beyond the unambiguous range"):
        place_target(cube((0, 0, -0.39)), None, short, APERTURE)
    with pytest.raises(RadarError, match=r"box: .*beyond the unambiguous range"):
        check_box(BOX, short, APERTURE)


def test_the_description_is_json() -> None:
    described = json.loads(json.dumps(place_target(cube(), None, CHIRP, APERTURE).describe(79e9)))
    assert described["material"]["name"] == "abs"
    np.testing.assert_allclose(described["bounds_m"], [[-0.02, -0.02, -0.32], [0.02, 0.02, -0.28]], atol=1e-9)
