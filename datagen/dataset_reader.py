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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_files import shard_file
from waveformer.datagen.dataset_layout import ArrayInfo, DatasetLayout
from waveformer.datagen.dataset_store import COMMITTED, QUARANTINED, read_commit, read_header
from waveformer.datagen.shard_reader import read_sample
from waveformer.simulator.errors import StoreError
from waveformer.simulator.radar import Aperture, Chirp


class _Shard(NamedTuple):
    committed: tuple[int, ...]
    quarantined: dict[int, str]
    files: frozenset[str]


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
    def _shards(self) -> dict[int, _Shard]:
        """The committed shards that were looked at so far."""
        return {}

    @cached_property
    def indices(self) -> NDArray[np.int64]:
        """Indices of the samples that are committed when this is first asked for, ascending, shape (n,)."""
        return np.array([i for shard in self._all_shards() for i in shard.committed], dtype=np.int64)

    @property
    def quarantined(self) -> dict[int, str]:
        """Why samples were given up, by index."""
        return {i: reason for shard in self._all_shards() for i, reason in shard.quarantined.items()}

    @property
    def num_pending(self) -> int:
        """Samples asked for that are neither committed nor given up."""
        return self.layout.num_samples - len(self) - len(self.quarantined)

    def __len__(self) -> int:
        return len(self.indices)

    def __getstate__(self) -> dict[str, Any]:
        """Without what was looked at so far: another process looks at what it needs."""
        return {"root": self.root, "layout": self.layout, "provenance": self.provenance}

    def record(self, index: int) -> dict[str, Any]:
        """What is known about a committed sample, JSON values; raises StoreError for any other."""
        self._committed(index)
        shard, row = divmod(int(index), self.layout.shard_samples)
        if self._last_commit.get("shard") != shard:  # samples are mostly asked for in order
            commit = read_commit(self.root, self.layout, shard)
            if commit is None:
                raise StoreError(f"{self.root}: the commit of shard {shard} was taken back: open it again")
            self._last_commit.update(commit)
        return dict(self._last_commit["samples"][row]["record"])

    def read(self, index: int, names: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Arrays of a committed sample.

        Args:
            index: of the sample.
            names: arrays wanted; None means all.

        Raises:
            StoreError: the sample is not committed, an array is unknown, or a file is damaged or missing.
        """
        files = self._committed(index).files
        shard, row = divmod(int(index), self.layout.shard_samples)
        found = {}
        for name in self.arrays if names is None else names:
            if name not in self.arrays:
                raise StoreError(f"{self.root} has no array {name!r}; it has {', '.join(self.arrays)}")
            info = self.arrays[name]
            relative = shard_file(name, shard, len(info.shape))
            if relative not in files:
                found[name] = info.empty(1)[0]
                continue
            try:
                found[name] = read_sample(self.root / relative, info, row, self.layout.shard_samples)
            except FileNotFoundError:
                raise StoreError(
                    f"{self.root / relative} is missing: run waveformer dataset verify"
                ) from None
        return found

    def _all_shards(self) -> list[_Shard]:
        found = (self._shard(number) for number in range(self.layout.num_shards))
        return [shard for shard in found if shard is not None]

    def _shard(self, number: int) -> _Shard | None:
        """A shard; None if it is not committed yet."""
        if (known := self._shards.get(number)) is not None:
            return known
        commit = read_commit(self.root, self.layout, number)
        if commit is None:
            return None
        samples = commit["samples"]
        shard = _Shard(
            tuple(item["index"] for item in samples if item["status"] == COMMITTED),
            {item["index"]: item["reason"] for item in samples if item["status"] == QUARANTINED},
            frozenset(commit["files"]),
        )
        return self._shards.setdefault(number, shard)

    @cached_property
    def _last_commit(self) -> dict[str, Any]:
        """The record that was read last; all of them would fill the memory."""
        return {}

    def _committed(self, index: int) -> _Shard:
        """The shard of a committed sample."""
        shard = None
        if 0 <= index < self.layout.num_samples:
            shard = self._shard(int(index) // self.layout.shard_samples)
        if shard is None or index not in shard.committed:
            reason = None if shard is None else shard.quarantined.get(int(index))
            state = "not made yet" if reason is None else f"quarantined ({reason})"
            raise StoreError(f"{self.root}: sample {index} is {state}; committed ones are in .indices")
        return shard

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
