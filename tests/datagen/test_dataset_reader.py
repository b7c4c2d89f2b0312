"""Reading: committed samples only, every number checked, nothing held that another process could not have."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

from waveformer.datagen.dataset_audit import withdraw
from waveformer.datagen.dataset_files import shard_file
from waveformer.datagen.dataset_reader import open_dataset
from waveformer.datagen.dataset_selection import known_names, select_samples
from waveformer.datagen.factory_run import Partition, run_factory
from waveformer.simulator import Aperture, Chirp
from waveformer.simulator.errors import StoreError

sys.path.append(str(Path(__file__).parent))
import reading_makers as makers

COUNT = 14
COMMITTED = [index for index in range(COUNT) if index not in makers.QUARANTINED]


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return makers.make(tmp_path_factory.mktemp("reader") / "store", COUNT)


def test_every_sample_is_what_was_made(store):
    data = open_dataset(store)
    assert data.indices.tolist() == COMMITTED
    for index in data.indices:
        found = data.read(index)
        assert found.keys() == {info.name for info in makers.ARRAYS}
        for name, values in makers.arrays_of(int(index)).items():
            assert found[name].dtype == values.dtype
            np.testing.assert_array_equal(found[name], values)
        assert data.record(index)["object_id"] == f"test/{index // 2}"


def test_arrays_can_be_written_to(store):
    for values in open_dataset(store).read(0).values():
        values[...] = 0
    assert open_dataset(store).read(0, ["truth_m"])["truth_m"].any()


def test_records_in_any_order(store, rng):
    data = open_dataset(store)
    for index in rng.permutation(COMMITTED):
        assert data.record(index)["view"] == index % 2


def test_what_is_not_committed_is_refused(store, tmp_path):
    data = open_dataset(store)
    assert data.quarantined.keys() == set(makers.QUARANTINED)
    with pytest.raises(StoreError, match=r"sample 3 is quarantined .*no faces"):
        data.read(3)
    for index in (-1, COUNT, 10**9):
        with pytest.raises(StoreError, match="not made yet"):
            data.read(index)
    part = tmp_path / "part"
    makers.create(part, COUNT)
    run_factory(part, partition=Partition(1, 2))
    data = open_dataset(part)
    assert (len(data), data.num_pending) == (6, 8)  # shards 1 and 3: samples 4-7 and 12-13
    with pytest.raises(StoreError, match="not made yet"):
        data.record(0)


def test_a_commit_that_is_taken_back(tmp_path):
    store = makers.make(tmp_path / "store", 8)
    data = open_dataset(store)
    data.record(0), data.record(5)
    withdraw(store, [0])
    with pytest.raises(StoreError, match="taken back"):
        data.record(1)
    assert data.record(5)["view"] == 1


def test_radar(store):
    data = open_dataset(store)
    assert data.chirp == Chirp(77.5001e9, 3.0009e9, makers.NUM_CHIRP_SAMPLES)
    np.testing.assert_array_equal(
        data.aperture.tx_m, Aperture.planar_grid(makers.NUM_X, makers.NUM_Y, 0.004).tx_m
    )


def test_every_flipped_bit_is_found(tmp_path, rng):
    store = makers.make(tmp_path / "store", 4)
    path = store / shard_file("truth_m", 0, 2)
    whole = path.read_bytes()
    for position in rng.integers(0, 8 * len(whole), 60):
        damaged = bytearray(whole)
        damaged[position // 8] ^= 1 << position % 8
        path.write_bytes(damaged)
        found = 0
        for index in (0, 1, 2):
            try:
                open_dataset(store).read(index, ["truth_m"])
            except StoreError:
                found += 1
        assert found >= 1
    for size in (0, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(StoreError, match="damaged"):
            open_dataset(store).read(0, ["truth_m"])
    path.unlink()
    with pytest.raises(StoreError, match="missing"):
        open_dataset(store).read(0, ["truth_m"])


def test_nothing_that_was_looked_at_goes_to_another_process(store):
    data = open_dataset(store)
    fresh = len(pickle.dumps(data))
    data.record(0)
    copy = pickle.loads(pickle.dumps(data))
    assert len(pickle.dumps(data)) == fresh
    np.testing.assert_array_equal(copy.indices, data.indices)


def test_selection(store):
    data = open_dataset(store)
    evaluation = [4, 5, 10, 11]  # objects 2 and 5
    assert select_samples(data, splits=["evaluation"]).tolist() == evaluation
    assert select_samples(data, splits=["evaluation"], categories=["spoon"]).tolist() == [10, 11]
    assert select_samples(data, object_ids=["test/1", "test/0"]).tolist() == [0, 1, 2]
    assert select_samples(data, limit=2).tolist() == [0, 1]
    assert select_samples(data, least_partial_points=100).tolist() == [10, 11, 12, 13]  # see the maker
    assert select_samples(data, least_partial_points=90, limit=2).tolist() == [9, 10]
    with pytest.raises(StoreError, match="split 'test': it has evaluation, train"):
        select_samples(data, splits=["test"])
    with pytest.raises(StoreError, match="no committed sample"):
        select_samples(data, splits=["evaluation"], object_ids=["test/0"])
    with pytest.raises(StoreError, match="limit"):
        select_samples(data, limit=0)


def test_names(store):
    data = open_dataset(store)
    assert known_names(data, None) == tuple(info.name for info in makers.ARRAYS)
    assert known_names(data, ["h", "pose", "h"]) == ("h", "pose")
    for names in (["truth"], []):
        with pytest.raises(StoreError, match="partial_count"):
            known_names(data, names)
