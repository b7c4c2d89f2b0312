"""The paper's ratio on clouds whose columns can be counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import ValidationError

from waveformer.model.uncertainty import UncertaintyTest, column_ratio
from waveformer.simulator.errors import RadarError


def sheet(tilt_deg: float, voxel_m: float, delta_m: float, offset_voxels: float = 0.1234) -> np.ndarray:
    """Voxels within delta of a tilted plane, at an offset from the lattice."""
    axis = np.arange(-40, 41) * voxel_m
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    tilt = np.radians(tilt_deg)
    distance = z * np.cos(tilt) - x * np.sin(tilt) + offset_voxels * voxel_m
    inside = (np.abs(distance) < delta_m) & (np.abs(z) < 36 * voxel_m)
    return np.stack([x[inside], y[inside], z[inside]], axis=1)


@pytest.mark.parametrize(("tilt_deg", "expected"), [(0, 0.50), (15, 0.48), (30, 0.43), (45, 0.35)])
def test_a_clean_sheet_at_delta_of_one_voxel(tilt_deg: float, expected: float) -> None:
    # measured with mmNorm's 1 mm / 1 mm, to two digits, and cos(tilt) / 2 on average over offsets
    offsets = (np.arange(8) + 0.5) / 8
    inverse = [1 / column_ratio(sheet(tilt_deg, 1e-3, 1e-3, offset), 1e-3) for offset in offsets]
    assert 1 / np.mean(inverse) == pytest.approx(expected, abs=0.01)


def test_it_depends_on_delta_over_voxel_only() -> None:
    assert column_ratio(sheet(30, 1e-3, 1e-3), 1e-3) == column_ratio(sheet(30, 3e-3, 3e-3), 3e-3)
    assert column_ratio(sheet(0, 1e-3, 0.5e-3), 1e-3) == 1.0


def test_single_voxels_and_stacks() -> None:
    stack = np.array([[0.1, 0.2, -0.4 + 0.003 * i] for i in range(4)])
    assert column_ratio(stack, 0.003) == 0.25
    assert column_ratio(stack + np.arange(4)[:, None] * [0.003, 0, 0], 0.003) == 1.0


def test_rule_as_printed_and_the_other_direction() -> None:
    assert [UncertaintyTest().is_uncertain(ratio) for ratio in (0.59, 0.6, 0.61)] == [False, False, True]
    below = UncertaintyTest(threshold=0.4, direction="below")
    assert [below.is_uncertain(ratio) for ratio in (0.39, 0.41)] == [True, False]


def test_an_empty_cloud_is_uncertain() -> None:
    ratio = column_ratio(np.empty((0, 3)), 0.003)
    assert math.isnan(ratio)
    assert UncertaintyTest().is_uncertain(ratio)


def test_bad_input_is_refused() -> None:
    with pytest.raises(RadarError, match="shape"):
        column_ratio(np.zeros((3, 2)), 0.003)
    with pytest.raises(RadarError, match="finite"):
        column_ratio(np.full((3, 3), np.nan), 0.003)
    with pytest.raises(RadarError, match="spacing"):
        column_ratio(np.zeros((3, 3)), 0.0)
    with pytest.raises(ValidationError):
        UncertaintyTest(direction="sideways")
