"""The named conditions."""

import numpy as np
import pytest

from waveformer.datagen.twin_conditions import CONDITIONS, quarter_wave_sheet, resolve_conditions
from waveformer.datagen.twin_echo import group_by_echo
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.simulator.errors import RadarError
from waveformer.simulator.slab import slab_reflection


def names(conditions):
    return [condition.name for condition in conditions]


def test_aliases_and_order():
    assert names(resolve_conditions(["nlos", "m30", "los", "clean"])) == ["clean", "m30", "box"]


@pytest.mark.parametrize(("given", "expected"), [(["fog"], "unknown condition 'fog'"), ([], "no condition")])
def test_refusals(given, expected):
    with pytest.raises(RadarError, match=expected):
        resolve_conditions(given)


def test_levels():
    assert CONDITIONS["clean"].front_end.is_ideal
    levels = {name: condition.front_end.mirror_snr_db for name, condition in CONDITIONS.items()}
    assert levels == {"clean": None, "m40": 40, "m30": 30, "rows": 50, "sheet": 46, "box": 40}
    rows_m = {name: condition.front_end.row_depth_error_m for name, condition in CONDITIONS.items()}
    assert rows_m == {"clean": 0, "m40": 0, "m30": 0, "rows": 3e-4, "sheet": 0, "box": 2e-4}


@pytest.mark.parametrize(("name", "reflection"), [("sheet", 0.1), ("box", 0.05)])
def test_sheets_reflect_what_they_are_called_for(name, reflection):
    sheet = CONDITIONS[name].sheet
    assert sheet is not None
    assert sheet.echo
    assert np.asarray(sheet.point_m)[2] == -0.26
    frequencies_hz = TwinSettings().chirp.frequencies_hz
    gamma = slab_reflection(sheet.permittivity, sheet.thickness_m, 1.0, frequencies_hz).s
    # At most 1.5 GHz from the quarter wave at 79 GHz, |Gamma| falls by 1 - cos(pi / 2 * 1.5 / 79): 0.05 %.
    assert np.abs(gamma) == pytest.approx(reflection, rel=1e-3)


def test_sheet_as_documented():
    sheet = quarter_wave_sheet(0.1)
    assert sheet.permittivity == pytest.approx(1.222, abs=1e-3)
    assert sheet.thickness_m == pytest.approx(0.858e-3, abs=1e-6)


def test_echoes_that_are_shared():
    groups = [names(group) for group in group_by_echo(list(CONDITIONS.values()))]
    assert groups == [["clean", "m40", "m30"], ["rows"], ["sheet"], ["box"]]
