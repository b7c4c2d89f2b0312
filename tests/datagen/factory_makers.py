"""Makers for the tests of the factory: cheap samples, and samples that fail in every way."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np

from waveformer.datagen.dataset_layout import ArrayInfo, DatasetLayout
from waveformer.simulator.errors import MeshError

ARRAYS = (
    ArrayInfo("cloud_m", (50, 3), "float32", ("point", "axis"), "m"),
    ArrayInfo("h", (20, 8), "complex64", ("position", "chirp_sample")),
    ArrayInfo("count", (2,), "int32", ("variant",)),
)


def layout(num_samples, maker="plain", shard_samples=4, **limits):
    return DatasetLayout("test", f"factory_makers:{maker}", {}, ARRAYS, num_samples, shard_samples, **limits)


def plain(root, index):
    rng = np.random.default_rng([7, index])
    arrays = {
        "cloud_m": rng.normal(size=(50, 3)).astype(np.float32),
        "h": (rng.normal(size=(20, 8)) + 1j * rng.normal(size=(20, 8))).astype(np.complex64),
        "count": rng.integers(0, 9, 2).astype(np.int32),
    }
    return arrays, {"object_id": f"test/{index}", "split": "train"}


def slow(root, index):
    time.sleep(0.05)
    return plain(root, index)


def poison(root, index):
    """Sample 2 crashes, 5 hangs, 9 is a bad mesh, 11 fills the memory; all others are plain."""
    if index == 2:
        os.kill(os.getpid(), signal.SIGSEGV)
    if index == 5:
        time.sleep(3600)
    if index == 9:
        raise MeshError("mesh.empty", "nine: no faces; export it again")
    if index == 11:
        return [bytearray(2**28) for _ in range(64)], {}
    return plain(root, index)


def crashes_once(root, index):
    """Sample 1 dies the first time only."""
    mark = Path(root).parent / "crashed"
    if index == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return plain(root, index)
