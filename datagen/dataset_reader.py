"""Reading a dataset: committed samples only, every number verified by its checksum, in any process.

data = open_dataset("store")
for index in data.indices:
sample = data.read(index, ["truth_m", "partial_m"])
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_files import shard_file
from waveformer.datagen.dataset_layout import ArrayInfo, DatasetLayout
from waveformer.datagen.dataset_store import COMMITTED, QUARANTINED, read_commit, read_header
from waveformer.datagen.shard_reader import read_sample
from waveformer.simulator.errors import StoreError
from waveformer.simulator.radar import Aperture, Chirp


@dataclass(frozen=True, eq=False)
class Dataset:
    """An open dataset; it holds no file handle, so it can be sent to other processes.

    Attributes:
        root: its folder.
        layout: arrays, samples, shards.
        provenance: versions that made it.
    """

    root: Path
    layout: DatasetLayout
    provenance: Mapping[str, Any]

    @cached_property
    def arrays(self) -> dict[str, ArrayInfo]:
        """Arrays by name."""
        return {info.name: info for info in self.layout.arrays}

    @cached_property
    def _commits(self) -> dict[int, dict[str, Any]]:
        found = (
            (shard, read_commit(self.root, self.layout, shard)) for shard in range(self.layout.num_shards)
        )
        return {shard: record for shard, record in found if record is not None}

    @cached_property
    def _samples(self) -> dict[int, dict[str, Any]]:
        return {item["index"]: item for record in self._commits.values() for item in record["samples"]}

    @cached_property
    def indices(self) -> NDArray[np.int64]:
        """Indices of the committed samples, ascending, shape (n,)."""
        return np.array(
            sorted(i for i, item in self._samples.items() if item["status"] == COMMITTED), dtype=np.int64
        )

    @property
    def quarantined(self) -> dict[int, str]:
        """Why samples were given up, by index."""
        return {
            i: item["reason"] for i, item in sorted(self._samples.items()) if item["status"] == QUARANTINED
        }

    @property
    def num_pending(self) -> int:
        """Samples asked for that are neither committed nor given up."""
        return self.layout.num_samples - len(self._samples)

    def __len__(self) -> int:
        return len(self.indices)

    def record(self, index: int) -> dict[str, Any]:
        """What is known about a committed sample, JSON values; raises StoreError for any other."""
        item = self._samples.get(int(index))
        if item is None or item["status"] != COMMITTED:
            state = "not made yet" if item is None else f"quarantined ({item['reason']})"
            raise StoreError(f"{self.root}: sample {index} is {state}; committed ones are in .indices")
        return dict(item["record"])

    def read(self, index: int, names: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Arrays of a committed sample.

        Args:
            index: of the sample.
            names: arrays wanted; None means all.

        Raises:
            StoreError: the sample is not committed, an array is unknown, or a file is damaged or missing.
        """
        self.record(index)
        shard, row = divmod(int(index), self.layout.shard_samples)
        found = {}
        for name in self.arrays if names is None else names:
            if name not in self.arrays:
                raise StoreError(f"{self.root} has no array {name!r}; it has {', '.join(self.arrays)}")
            info = self.arrays[name]
            relative = shard_file(name, shard, len(info.shape))
            if relative not in self._commits[shard]["files"]:
                found[name] = info.empty(1)[0]
                continue
            try:
                found[name] = read_sample(self.root / relative, info, row, self.layout.shard_samples)
            except FileNotFoundError:
                raise StoreError(
                    f"{self.root / relative} is missing: run waveformer dataset verify"
                ) from None
        return found

    @property
    def chirp(self) -> Chirp | None:
        """Of the signals; None without."""
        signal = self.layout.settings.get("signal")
        return Chirp(**signal["chirp"]) if signal else None

    @property
    def aperture(self) -> Aperture | None:
        """Antenna positions; None if there are none."""
        planar = self.layout.settings.get("aperture")
        return Aperture.planar_grid(planar["num_x"], planar["num_y"], planar["spacing_m"]) if planar else None


def open_dataset(path: str | Path) -> Dataset:
    """Open a dataset that `waveformer generate` or `propose` wrote, finished or not.

    Raises:
        StoreError: there is none, it is damaged, or of another version.
    """
    root = Path(path)
    header = read_header(root)
    return Dataset(root, DatasetLayout.from_json(header["layout"]), header["provenance"])
