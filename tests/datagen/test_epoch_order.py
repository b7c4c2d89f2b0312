"""Orders of epochs: a function of seed and epoch, shared out without overlap."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.datagen.epoch_order import EpochOrder
from waveformer.simulator.errors import RadarError


def test_an_order_is_a_permutation_that_repeats():
    first = EpochOrder(100, seed=0).of(0)
    assert sorted(first) == list(range(100))
    np.testing.assert_array_equal(first, EpochOrder(100, seed=0).of(0))
    for other in (EpochOrder(100, seed=0).of(1), EpochOrder(100, seed=1).of(0), np.arange(100)):
        assert (first != other).any()


@pytest.mark.parametrize("world_size", [1, 2, 3, 7])
def test_processes_share_an_epoch(world_size):
    parts = [EpochOrder(23, 5, rank=rank, world_size=world_size).of(4) for rank in range(world_size)]
    assert {len(part) for part in parts} == {23 // world_size}
    together = np.concatenate(parts)
    assert len(set(together)) == len(together)


def test_no_sample_is_left_out_for_ever():
    seen = set()
    for epoch in range(20):
        seen |= {int(i) for rank in range(3) for i in EpochOrder(11, 0, rank=rank, world_size=3).of(epoch)}
    assert seen == set(range(11))


def test_evaluation_visits_each_sample_once():
    parts = [EpochOrder(11, shuffle=False, rank=rank, world_size=3) for rank in range(3)]
    assert [len(part) for part in parts] == [4, 4, 3]
    assert sorted(np.concatenate([part.of(9) for part in parts])) == list(range(11))


@pytest.mark.parametrize(
    "bad", [{"rank": 2, "world_size": 2}, {"rank": -1}, {"world_size": 0}, {"count": 3, "world_size": 4}]
)
def test_what_makes_no_sense_is_refused(bad):
    with pytest.raises(RadarError):
        EpochOrder(**{"count": 10, **bad})
