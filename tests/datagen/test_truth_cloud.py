"""The unit sphere around ground-truth points, and what is refused."""

import numpy as np
import pytest

from waveformer.datagen.truth_cloud import TruthCloud, finite_points
from waveformer.simulator.errors import MeshError

CROSS_M = np.array([(3.0, 0, 0), (-1.0, 0, 0), (1.0, 0.5, 0), (1.0, -0.5, 0)])


def test_centroid_and_radius():
    truth = TruthCloud(CROSS_M)
    np.testing.assert_array_equal(truth.center_m, [1, 0, 0])
    assert truth.radius_m == 2.0
    np.testing.assert_array_equal(truth.to_unit_sphere(np.array([[1.0, 2, 0]])), [[0, 1, 0]])


def test_one_place_is_refused():
    with pytest.raises(MeshError, match="5 points in one place"):
        TruthCloud(np.ones((5, 3)))
    with pytest.raises(MeshError, match="0 points"):
        TruthCloud(np.empty((0, 3)))


def test_normals_go_with_points():
    with pytest.raises(MeshError, match="3 normals for 4 points"):
        TruthCloud(CROSS_M, CROSS_M[:3])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_not_finite_is_refused_in_one_line(bad):
    points = CROSS_M.copy()
    points[1, 2] = bad
    with pytest.raises(MeshError) as refusal:
        finite_points("prediction", points)
    assert str(refusal.value) == "prediction: 1 of 4 points are not finite (NaN or infinity); drop them first"


@pytest.mark.parametrize("shape", [(4,), (4, 2), (2, 4, 3)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(MeshError, match="shape"):
        finite_points("prediction", np.ones(shape))
    with pytest.raises(MeshError, match="numbers"):
        finite_points("prediction", "cloud")


def test_no_points_are_a_cloud():
    assert finite_points("prediction", []).shape == (0, 3)


def test_the_cloud_is_a_copy_that_nobody_changes():
    points = CROSS_M.copy()
    truth = TruthCloud(points)
    points[:] = 0
    assert truth.radius_m == 2.0
    with pytest.raises(ValueError, match="read-only"):
        truth.points_m[0] = 1
