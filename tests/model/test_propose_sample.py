"""Candidates of a signal as arrays; the whole way from a dataset runs in tests/waveformer/test_cli_generate.py."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from waveformer.datagen.farthest_points import farthest_points
from waveformer.model.propose_sample import _FARTHEST, _candidates, _spread
from waveformer.model.propose_settings import ProposeSettings
from waveformer.model.surfaces import SurfaceStack


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


def test_candidates_are_levels_of_the_main_component_with_the_others_at_their_choice() -> None:
    stacks = [levels_at([-0.41, -0.40, -0.39], x_m=0.0), levels_at([-0.45, -0.44], x_m=0.1)]
    losses = [np.array([[0.6], [0.2], [0.4]]), np.array([[0.5], [0.3]])]
    proposal = SimpleNamespace(
        selection=SimpleNamespace(level_index=(1, 0), antenna_losses=losses),
        levels_m=[np.array([0.0, 0.01, 0.02]), np.array([0.0, 0.01])],
        stacks=stacks,
    )
    truth_m = np.concatenate([stacks[0].points_at(2), stacks[1].points_at(0)])
    found = _candidates(proposal, truth_m, ProposeSettings(candidates=4, points=16))
    assert found["candidate_count"].tolist() == [10, 10, 10, 0]
    for place, level in enumerate([1, 2, 0]):  # least loss first
        expected = np.concatenate([stacks[0].points_at(level), stacks[1].points_at(0)])
        kept = found["candidate_m"][place][:10]
        assert kept[np.lexsort(kept.T)] == pytest.approx(
            expected[np.lexsort(expected.T)], abs=1e-7
        )  # float32
    assert (found["chosen"], found["best"]) == (0, 1)


def levels_at(heights_m: list[float], x_m: float) -> SurfaceStack:
    """Five points at each height, a millimetre apart."""
    points = np.array([[x_m, 1e-3 * i, z] for z in heights_m for i in range(5)])
    level = np.repeat(np.arange(len(heights_m)), 5)
    return SurfaceStack(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.ones(len(points)), level)
