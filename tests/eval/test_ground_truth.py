"""The reference level is the one nearest to the mesh."""

import numpy as np
import pytest

from waveformer.eval.ground_truth import reference_level
from waveformer.simulator.errors import RadarError


def test_reference_level(rng):
    # A field that is the signed distance plus an error that grows sideways.
    distance_m = rng.uniform(-0.02, 0.02, 5000)
    potential_m = distance_m + 0.003 + 0.001 * rng.normal(size=5000)
    levels_m = np.arange(-0.02, 0.02, 0.002)
    index = reference_level(potential_m, distance_m, levels_m, 0.001)
    assert levels_m[index] == pytest.approx(0.003, abs=0.0011)  # half a step


def test_levels_without_voxels_are_passed_over():
    assert reference_level([0.0, 0.01], [0.005, -0.001], [-1.0, 0.0, 0.01, 2.0], 0.001) == 2


def test_no_level_near_any_voxel():
    with pytest.raises(RadarError, match="none of 2 levels"):
        reference_level([0.0], [0.0], [1.0, 2.0], 0.001)
    with pytest.raises(RadarError, match="2 potentials for 1 distances"):
        reference_level([0.0, 1.0], [0.0], [1.0], 0.001)
