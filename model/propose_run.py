"""Preparing a dataset of candidate surfaces from a dataset of signals."""

from __future__ import annotations

import hashlib
from pathlib import Path

from waveformer.datagen.dataset_layout import DatasetLayout
from waveformer.datagen.dataset_reader import open_dataset
from waveformer.datagen.dataset_store import create_dataset
from waveformer.datagen.generate_run import provenance
from waveformer.model.propose_sample import COPIED, INDICES_FILE, MAKER, SOURCE_FILE, arrays_of
from waveformer.model.propose_settings import ProposeSettings
from waveformer.simulator.errors import StoreError

_GIB = 2**30


def prepare_proposals(root: Path, source: Path, settings: ProposeSettings) -> DatasetLayout:
    """Create the dataset in which the candidates of all committed signals of another will lie, or accept the one that is there.

    Args:
        root: of the dataset to make.
        source: of the dataset with signals, from `waveformer generate`.
        settings: of the candidates.

    Returns:
        Its layout; `factory_run.run_factory` makes the samples.

    Raises:
        StoreError: the source has no signals, something else is at `root`, or it cannot be written.
    """
    data = open_dataset(source)
    if missing := [name for name in (*COPIED, "h") if name not in data.arrays]:
        raise StoreError(f"{source} has no array {missing[0]!r}: make it with waveformer generate --signals")
    if len(data) == 0:
        raise StoreError(f"{source} has no committed sample")
    tables = {
        SOURCE_FILE: f"{source.resolve()}\n".encode(),
        INDICES_FILE: "".join(f"{index}\n" for index in data.indices).encode(),
    }
    layout = DatasetLayout(
        "propose",
        MAKER,
        settings.model_dump(mode="json"),
        arrays_of(settings, data),
        len(data),
        settings.shard_samples,
        {name: hashlib.sha256(content).hexdigest() for name, content in tables.items()},
        settings.time_limit_s,
        round(settings.memory_limit_gib * _GIB),
    )
    create_dataset(root, layout, tables, {**provenance(), "source": dict(data.provenance)})
    return layout
