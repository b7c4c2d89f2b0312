"""Samples a second from a dataset into torch, by spawned workers: the recipe of docs/datasets.md.

Arrays have the sizes of a generated dataset and hold noise. Warm-up starts the workers; the samples read then are read
for the first time by this process, from memory ("in memory") or after the system was told to forget them ("from disk").

    python benchmarks/dataset_reading.py [--quick] [--store FOLDER]
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from waveformer.datagen.dataset_layout import ArrayInfo, DatasetLayout
from waveformer.datagen.dataset_store import create_dataset
from waveformer.datagen.factory_run import run_factory

ARRAYS = (
    ArrayInfo("truth_m", (16_384, 3), "float32", ("truth_point", "axis"), "m"),
    ArrayInfo("truth_normals", (16_384, 3), "float32", ("truth_point", "axis")),
    ArrayInfo("partial_m", (2, 2_048, 3), "float32", ("variant", "partial_point", "axis"), "m"),
    ArrayInfo("h", (7_676, 64), "complex64", ("position", "chirp_sample")),
)
CLOUDS, ALL = ("truth_m", "truth_normals", "partial_m"), tuple(info.name for info in ARRAYS)
SHARD_SAMPLES, BATCH_SIZE, WORKERS = 7, 10, 2
MEASURED, WARM_UP = 100, 40
READ_AHEAD = 2 * WORKERS * BATCH_SIZE  # may be there when the clock starts, so they do not count
TARGETS = {CLOUDS: 200.0, ALL: 50.0}


def make_sample(root: str, index: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Noise in the place of a sample."""
    rng = np.random.default_rng(index)
    arrays = {}
    for info in ARRAYS:
        count = int(np.prod(info.shape)) * (2 if info.dtype == "complex64" else 1)
        arrays[info.name] = rng.standard_normal(count, dtype=np.float32).view(info.dtype).reshape(info.shape)
    return arrays, {"object_id": f"noise/{index}", "split": "train"}


def create(store: Path, num_samples: int) -> None:
    maker = f"{Path(__file__).stem}:{make_sample.__name__}"
    layout = DatasetLayout("benchmark", maker, {}, ARRAYS, num_samples, SHARD_SAMPLES)
    create_dataset(store, layout, {}, {})
    run_factory(store)


def forget(store: Path) -> None:
    """Take the store's files out of the system's memory."""
    for path in store.rglob("*"):
        if path.is_file():
            descriptor = os.open(path, os.O_RDONLY)
            os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
            os.close(descriptor)


def rate(store: Path, arrays: tuple[str, ...], seed: int, from_disk: bool) -> float:
    """Samples a second after the warm-up."""
    from waveformer.datagen.torch_dataset import SampleDataset
    from waveformer.datagen.torch_loader import data_loader

    loader = data_loader(SampleDataset(store, arrays), batch_size=BATCH_SIZE, num_workers=WORKERS, seed=seed)
    batches = iter(loader)
    for _ in range(WARM_UP // BATCH_SIZE):
        next(batches)
    if from_disk:
        forget(store)
    started, total = time.perf_counter(), 0.0
    for batch in batches:
        total += sum(float(values.real.sum()) for values in batch.values())
    seconds = time.perf_counter() - started
    assert np.isfinite(total)
    return MEASURED / seconds


def main(quick: bool, store: Path) -> None:
    create(store, WARM_UP + READ_AHEAD + MEASURED)
    for arrays in (CLOUDS, ALL):
        for from_disk in (False, True):
            rates = [rate(store, arrays, seed, from_disk) for seed in range(1 if quick else 3)]
            place = "from disk" if from_disk else "in memory"
            values = ", ".join(f"{value:.0f}" for value in sorted(rates))
            print(
                f"{'+'.join(arrays)}, {place}: {values} samples/s (asked: at least {TARGETS[arrays]:.0f}), "
                f"load {os.getloadavg()[0]:.1f}"
            )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="one run each instead of three")
    parser.add_argument("--store", type=Path, help="keep the dataset here (0.8 GB) and use it again")
    options = parser.parse_args()
    if options.store is not None:
        main(options.quick, options.store)
        sys.exit()
    with tempfile.TemporaryDirectory() as folder:
        main(options.quick, Path(folder) / "store")
