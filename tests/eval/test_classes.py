"""Bounds of the classes and means over them."""

import numpy as np
import pytest
import trimesh

from waveformer.eval.classes import (
    class_means,
    coverage_class,
    longest_side_m,
    mean_of_class_means,
    size_class,
)
from waveformer.simulator.errors import RadarError
from waveformer.simulator.mesh import load_mesh


@pytest.mark.parametrize(
    ("side_m", "name"), [(0.201, "large"), (0.2, "medium"), (0.1, "medium"), (0.099, "small")]
)
def test_sizes(side_m, name):
    assert size_class(side_m) == name


@pytest.mark.parametrize(
    ("share", "name"),
    [(1, "high"), (0.361, "high"), (0.36, "middle"), (0.18, "middle"), (0.179, "low"), (0, "low")],
)
def test_coverages(share, name):
    assert coverage_class(share) == name


@pytest.mark.parametrize("value", [np.nan, -0.1])
def test_nonsense_has_no_class(value):
    with pytest.raises(RadarError, match="longest side"):
        size_class(value)
    with pytest.raises(RadarError, match="coverage"):
        coverage_class(value)


def test_longest_side_of_a_mesh():
    assert longest_side_m(load_mesh(trimesh.creation.box((0.1, 0.25, 0.05)))) == pytest.approx(0.25)


def test_development_objects_fill_all_classes(shared_meshes):
    sides = [longest_side_m(load_mesh(path)) for path in sorted((shared_meshes / "ycb").glob("*.ply"))]
    counts = {name: [size_class(side) for side in sides].count(name) for name in ("large", "medium", "small")}
    assert counts == {"large": 3, "medium": 9, "small": 4}


def test_means():
    labels = ["small", "large", "small", "small"]
    assert class_means([1, 10, 2, 3], labels) == {"small": 2, "large": 10}
    assert mean_of_class_means([1, 10, 2, 3], labels) == 6
    assert np.isnan(mean_of_class_means([], []))
    with pytest.raises(RadarError, match="2 values for 1"):
        class_means([1, 2], ["small"])
