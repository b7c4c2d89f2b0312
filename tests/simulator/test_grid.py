"""Voxel grids: coordinates, ends, and what is refused."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid


def test_a_box_holds_both_ends_where_the_spacing_divides_it() -> None:
    grid = Grid.box([0.0, -0.1, -0.4], [0.3, 0.1, -0.4], 0.1)
    assert grid.x == pytest.approx([0, 0.1, 0.2, 0.3])  # 0.3 / 0.1 is 2.999.. in floating point
    assert grid.y == pytest.approx([-0.1, 0, 0.1])
    assert grid.z == pytest.approx([-0.4])
    assert grid.shape == (4, 3, 1)


def test_a_box_never_reaches_beyond_its_far_corner() -> None:
    grid = Grid.box([0, 0, 0], [0.35, 0.05, 0.1], 0.1)
    assert grid.shape == (4, 1, 2)
    assert grid.x[-1] <= 0.35


def test_the_axes_are_copies_and_read_only() -> None:
    x = np.array([0.0, 1.0])
    grid = Grid(x, [0], [0])  # type: ignore[arg-type]
    x[0] = -1
    assert grid.x[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        grid.x[0] = 5
    with pytest.raises(dataclasses.FrozenInstanceError):
        grid.x = x  # type: ignore[misc]


def test_uneven_axes_are_allowed() -> None:
    assert Grid([0, 1, 10], [0], [-3, -1]).shape == (3, 1, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("axis", "says"),
    [
        ([], "non-empty 1-D"),
        ([[0.0, 1.0]], "non-empty 1-D"),
        ([0.0, np.nan], "finite"),
        ([0.0, 0.0], "increase strictly"),
        ([1.0, 0.0], "increase strictly"),
    ],
)
def test_a_bad_axis_is_refused_by_its_name(axis: Any, says: str) -> None:
    with pytest.raises(RadarError, match=f"axis y must .*{says}"):
        Grid([0], axis, [0])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("low", "high", "spacing_m", "says"),
    [
        ([0, 0], [1, 1], 0.1, "each of shape"),
        ([0, 0, 1], [1, 1, 0], 0.1, "min_m <= max_m"),
        ([0, 0, np.nan], [1, 1, 1], 0.1, "corners must be finite"),
        ([0, 0, 0], [1, 1, 1], 0.0, "spacing_m must be positive"),
        ([0, 0, 0], [1, 1, 1], -0.1, "spacing_m must be positive"),
        ([0, 0, 0], [1, 1, 1], np.nan, "spacing_m must be positive"),
        ([0, 0, 0], [1, 1, 1], 1e-4, "10001 x 10001 x 10001 .* raise spacing_m"),
    ],
)
def test_a_senseless_box_is_refused(low: Any, high: Any, spacing_m: float, says: str) -> None:
    with pytest.raises(RadarError, match=says):
        Grid.box(low, high, spacing_m)
