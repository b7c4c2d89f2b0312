"""Clouds of a fixed size: filled with NaN, never by repetition."""

import numpy as np
import pytest

from waveformer.datagen.partial_cloud import fixed_size, without_padding
from waveformer.simulator.errors import RadarError


@pytest.mark.parametrize("count", [0, 3, 5])
def test_rows_beyond_the_points_are_nan(rng, count):
    points_m = rng.normal(size=(count, 3))
    fixed = fixed_size(points_m, 5)
    assert fixed.points_m.shape == (5, 3)
    assert fixed.points_m.dtype == np.float32
    assert fixed.num_valid == count
    assert np.isnan(fixed.points_m[count:]).all()
    np.testing.assert_array_equal(without_padding(*fixed), points_m.astype(np.float32))


def test_more_points_are_refused(rng):
    with pytest.raises(RadarError, match="6 points does not fit into 5"):
        fixed_size(rng.normal(size=(6, 3)), 5)
