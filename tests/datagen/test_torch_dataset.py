"""torch: what comes out is what was stored, in the same order for any number of workers, and training resumes."""

from __future__ import annotations

import copy
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from waveformer.datagen.torch_dataset import SampleDataset, SampleStream
from waveformer.datagen.torch_loader import data_loader
from waveformer.simulator.errors import RadarError, StoreError

sys.path.append(str(Path(__file__).parent))
import reading_makers as makers

COUNT = 26
NAMES = ("partial_m", "h", "pose")


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return makers.make(tmp_path_factory.mktemp("torch") / "store", COUNT)


def visited(batches):
    """Indices in the order they come, batch by batch."""
    return [batch["index"].tolist() for batch in batches]


def test_items_are_the_samples(store):
    samples = SampleDataset(store, NAMES)
    assert len(samples) == COUNT - len(makers.QUARANTINED)
    item = samples[3]  # sample 3 is quarantined
    assert item.keys() == {*NAMES, "index"}
    assert int(item["index"]) == 4
    for name in NAMES:
        np.testing.assert_array_equal(item[name].numpy(), makers.arrays_of(4)[name])
    assert item["h"].dtype == torch.complex64
    assert visited([SampleDataset(store, categories=["spoon"])[0]]) == [2]
    with pytest.raises(StoreError, match="no array 'clouds'"):
        SampleDataset(store, ["clouds"])


def test_workers_change_nothing(store):
    samples = SampleDataset(store, NAMES)
    alone = data_loader(samples, batch_size=4, num_workers=0, seed=1)
    spawned = data_loader(samples, batch_size=4, num_workers=2, seed=1)
    orders = []
    for _ in range(2):  # the second epoch is by the same workers
        order = []
        for expected, batch in zip(alone, spawned, strict=True):
            order += batch["index"].tolist()
            for name in (*NAMES, "index"):
                torch.testing.assert_close(batch[name], expected[name], rtol=0, atol=0, equal_nan=True)
        orders.append(order)
    assert sorted(orders[0]) == sorted(orders[1]) == samples.indices.tolist()
    assert orders[0] != orders[1]
    stream = SampleStream(samples, seed=1)
    # one more start of workers, so the stream is tried here too
    batches = DataLoader(
        stream, batch_size=None, num_workers=2, multiprocessing_context="spawn", persistent_workers=True
    )
    for epoch in range(2):
        stream.set_epoch(epoch)
        assert [int(item["index"]) for item in batches] == orders[epoch]


def test_training_goes_on_inside_an_epoch(store):
    samples = SampleDataset(store, ["pose"])
    whole = data_loader(samples, batch_size=5, num_workers=0)
    expected = [visited(whole) for _ in range(3)]
    loader = data_loader(samples, batch_size=5, num_workers=0)
    assert visited(loader) == expected[0]
    state = None
    for number, _ in enumerate(loader):
        if number == 1:
            state = copy.deepcopy(loader.state_dict())
            break
    again = data_loader(samples, batch_size=5, num_workers=0)
    again.load_state_dict(state)
    again.set_epoch(1)  # as trainers do
    assert len(again) == 3
    assert visited(again) == expected[1][2:]
    assert len(again) == 5
    assert visited(again) == expected[2]
    assert visited(loader) == expected[1]  # left early: it begins again


def test_the_state_does_not_run_ahead_with_the_workers(store):
    samples = SampleDataset(store, ["pose"])
    expected = visited(data_loader(samples, batch_size=3, num_workers=0))
    loader = data_loader(samples, batch_size=3, num_workers=1)
    batches = iter(loader)
    assert [next(batches)["index"].tolist() for _ in range(2)] == expected[:2]
    again = data_loader(samples, batch_size=3, num_workers=0)
    again.load_state_dict(loader.state_dict())
    assert visited(again) == expected[2:]
    for _ in batches:  # workers that are stopped while they send complain
        pass


def test_a_state_of_something_else_is_refused(store):
    samples = SampleDataset(store, ["pose"])
    state = data_loader(samples, batch_size=5, num_workers=0, seed=1).state_dict()
    with pytest.raises(StoreError, match="seed"):
        data_loader(samples, batch_size=5, num_workers=0, seed=2).load_state_dict(state)
    others = SampleDataset(store, ["pose"], splits=["train"])
    with pytest.raises(StoreError, match="samples_sha256"):
        data_loader(others, batch_size=5, num_workers=0, seed=1).load_state_dict(state)


def test_processes_of_data_parallel_training(store):
    samples = SampleDataset(store, ["pose"])
    seen = []
    for rank in range(3):
        loader = data_loader(samples, batch_size=4, num_workers=0, rank=rank, world_size=3, drop_last=True)
        assert len(loader) == 2
        seen += [index for batch in visited(loader) for index in batch]
    assert len(seen) == len(set(seen)) == 24
    with pytest.raises(RadarError, match="rank"):
        data_loader(samples, batch_size=4, num_workers=0, rank=3, world_size=3)


def test_the_stream_alone(store):
    samples = SampleDataset(store, ["pose"])
    stream = SampleStream(samples, shuffle=False, rank=1, world_size=2)
    assert len(stream) == 12
    assert [int(item["index"]) for item in stream] == samples.indices[1::2].tolist()
