"""Candidates of a signal as arrays; the whole way from a dataset runs in tests/waveformer/test_cli_generate.py."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.datagen.farthest_points import farthest_points
from waveformer.model.propose_sample import _FARTHEST, _spread


@pytest.mark.parametrize(
    ("size", "count", "expected"), [(5000, 2048, 2048), (1500, 2048, 1500), (40, 2048, 40)]
)
def test_a_candidate_keeps_points_of_its_own_each_once(
    rng: np.random.Generator, size: int, count: int, expected: int
) -> None:
    points = rng.normal(size=(size, 3))
    kept = _spread(points, count)
    assert kept.shape == (expected, 3)
    assert len(np.unique(kept, axis=0)) == expected
    assert {tuple(point) for point in kept} <= {tuple(point) for point in points}


def test_its_first_points_are_its_farthest(rng: np.random.Generator) -> None:
    columns = np.arange(6000)[:, None] * [1e-4, 0.0, 0.0] + rng.normal(scale=1e-3, size=(6000, 3))
    kept = _spread(columns, 2048)
    first = kept[:_FARTHEST]
    assert (first == kept[farthest_points(kept, _FARTHEST)]).all()
    assert np.ptp(first[:, 0]) > 0.99 * np.ptp(columns[:, 0])  # over the whole, not its first columns
