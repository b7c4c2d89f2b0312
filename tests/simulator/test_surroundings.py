"""Antennas and occluders of a scene: what they accept, say and refuse."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import RadarError
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.surroundings import Surroundings

SHEET = Sheet((0, 0, -0.2), (0, 0, 1), 0.003, "foam")
BOX = Box((-0.1, -0.1, -0.5), (0.1, 0.1, -0.3), 0.003, "cardboard")


def test_by_default_nothing_is_in_the_way() -> None:
    empty = Surroundings()
    assert not empty.occludes and empty.antenna.is_isotropic and empty.sheets == () and empty.box is None
    np.testing.assert_array_equal(empty.polarization, [0.0, 1.0, 0.0])


def test_sheets_and_boxes_occlude() -> None:
    assert Surroundings(sheets=[SHEET]).occludes
    assert Surroundings(box=BOX).occludes
    assert not Surroundings(antenna=Antenna.from_preset("iwr1443")).occludes


def test_one_sheet_may_stand_alone() -> None:
    assert Surroundings(sheets=SHEET).sheets == (SHEET,)  # type: ignore[arg-type]


def test_polarization_is_a_direction() -> None:
    given = np.array([3.0, 0.0, 4.0])
    polarization = Surroundings(polarization=given).polarization
    np.testing.assert_allclose(polarization, [0.6, 0.0, 0.8])
    given[0] = 7.0
    assert polarization[0] == 0.6
    with pytest.raises(ValueError, match="read-only"):
        polarization[0] = 1.0  # type: ignore[index]


@pytest.mark.parametrize(
    ("how", "named"),
    [
        ({"sheets": ["cardboard"]}, "sheets must be Sheet objects"),
        ({"sheets": [SHEET, BOX]}, "sheets must be Sheet objects"),
        ({"box": SHEET}, "box must be a Box"),
        ({"antenna": "iwr1443"}, "antenna must be an Antenna"),
        ({"polarization": (0, 0, 0)}, "polarization"),
        ({"polarization": (0, 1)}, "polarization"),
        ({"polarization": (0, float("nan"), 1)}, "polarization"),
        ({"polarization": "y"}, "polarization"),
    ],
)
def test_what_is_refused(how: dict[str, Any], named: str) -> None:
    with pytest.raises(RadarError, match=named) as refused:
        Surroundings(**how)
    assert "\n" not in str(refused.value) and "<class" not in str(refused.value)


def test_the_description_is_json() -> None:
    described = json.loads(json.dumps(Surroundings(sheets=[SHEET, SHEET], box=BOX).describe(79e9)))
    assert [sheet["name"] for sheet in described["sheets"]] == ["foam", "foam"]
    assert described["box"]["name"] == "cardboard" and described["polarization"] == [0.0, 1.0, 0.0]
    assert "box" not in Surroundings().describe(79e9)
