"""Sheets and boxes as objects: what they hold, say and refuse."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Box, Sheet

SHEET = {"point_m": [0, 0, -0.2], "normal": [0, 0, 1], "thickness_m": 3e-3, "permittivity": 1.5 - 0.05j}
BOX = {
    "min_m": [-0.1, -0.1, -0.5],
    "max_m": [0.1, 0.1, -0.3],
    "thickness_m": 3e-3,
    "permittivity": "cardboard",
}


def test_a_sheet_is_a_slab():
    sheet = Sheet(**SHEET)
    assert sheet.material == Material.dielectric(1.5 - 0.05j, 3e-3)
    assert sheet.echo is False


def test_a_sheet_may_be_named():
    assert Sheet(**SHEET | {"permittivity": "foam"}).material == Material.named("foam", 3e-3)


def test_the_normal_is_made_a_unit_vector():
    assert_allclose(Sheet(**SHEET | {"normal": [3, 0, 4]}).normal, [0.6, 0, 0.8])


def test_positions_cannot_change_behind_the_sheet():
    point = np.array([0.0, 0.0, -0.2])
    sheet = Sheet(**SHEET | {"point_m": point})
    point[2] = 5.0
    assert sheet.point_m[2] == -0.2
    with pytest.raises(ValueError, match="read-only"):
        sheet.point_m[2] = 1.0


@pytest.mark.parametrize("occluder", [Sheet(**SHEET), Box(**BOX)])
def test_a_description_is_json_and_holds_the_permittivity_at_the_frequency(occluder):
    described = json.loads(json.dumps(occluder.describe(79e9)))
    value = occluder.material.permittivity.at(79e9)
    assert described["permittivity"] == [value.real, value.imag]
    assert described["thickness_m"] == 3e-3


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"point_m": [0, 0]}, "point_m"),
        ({"point_m": [0, 0, float("nan")]}, "point_m"),
        ({"point_m": "here"}, "point_m"),
        ({"normal": [0, 0, 0]}, "normal"),
        ({"thickness_m": 0.0}, "thickness_m"),
        ({"thickness_m": 0.3}, "thickness_m"),
        ({"thickness_m": True}, "thickness_m"),
        ({"thickness_m": "thin"}, "thickness_m"),
        ({"permittivity": "unobtainium"}, "unobtainium"),
        ({"permittivity": 1.5 + 0.05j}, "eps''"),
    ],
)
def test_impossible_sheets_are_refused(changed, named):
    with pytest.raises(RadarError, match=named):
        Sheet(**SHEET | changed)


def test_a_box_has_walls_of_one_material():
    assert Box(**BOX).material == Material.named("cardboard", 3e-3)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"min_m": [0.1, -0.1, -0.5]}, "no inside"),
        ({"thickness_m": 0.1}, "no inside"),
        ({"max_m": [0.1, 0.1]}, "max_m"),
        ({"min_m": [-0.1, -0.1, float("inf")]}, "min_m"),
        ({"thickness_m": -1e-3}, "thickness_m"),
        ({"permittivity": 0.5}, "eps'"),
    ],
)
def test_impossible_boxes_are_refused(changed, named):
    with pytest.raises(RadarError, match=named):
        Box(**BOX | changed)
