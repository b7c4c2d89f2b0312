"""Datasets for torch: by position (`SampleDataset`), or as a stream (`SampleStream`).

Both hold a folder's name and indices, no file: every worker process opens what it reads itself. This module and the
other `torch_` ones load torch when imported.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset, IterableDataset, get_worker_info

from waveformer.datagen.dataset_reader import open_dataset
from waveformer.datagen.dataset_selection import known_names, select_samples
from waveformer.datagen.epoch_order import EpochOrder

Item = dict[str, torch.Tensor]


class SampleDataset(Dataset[Item]):
    """Committed samples by position: item i is a dict of tensors by array name, and "index", int64 ().

    Attributes:
        indices: of the samples in the store, shape (n,).
        names: of the arrays.
    """

    def __init__(
        self,
        store: str | Path,
        arrays: Collection[str] | None = None,
        *,
        splits: Collection[str] | None = None,
        object_ids: Collection[str] | None = None,
        categories: Collection[str] | None = None,
        least_partial_points: int = 0,
    ) -> None:
        """Choose samples; see `select_samples`.

        Args:
            store: folder of the dataset.
            arrays: names of those wanted; None means all.
            splits: wanted; None means all.
            object_ids: wanted; None means all.
            categories: wanted; None means all.
            least_partial_points: that Eq. 2-3 kept in each partial.

        Raises:
            StoreError: there is no dataset, it is damaged, or it has no such array or sample.
        """
        self._data = open_dataset(store)
        self.names = known_names(self._data, arrays)
        self.indices: NDArray[np.int64] = select_samples(
            self._data,
            splits=splits,
            object_ids=object_ids,
            categories=categories,
            least_partial_points=least_partial_points,
        )

    def __len__(self) -> int:
        return len(self.indices)

    def __getitem__(self, position: int) -> Item:
        """One sample; raises StoreError if it is damaged."""
        index = int(self.indices[position])
        arrays = self._data.read(index, self.names)
        return {
            **{name: torch.from_numpy(values) for name, values in arrays.items()},
            "index": torch.tensor(index),
        }


class SampleStream(IterableDataset[Item]):
    """The samples of a `SampleDataset` one after the other, each epoch in an order of its own.

    Each worker of a DataLoader takes every so-many-th sample, so that with batch_size=None the samples come in the
    epoch's order whatever the number of workers.
    """

    def __init__(
        self,
        samples: SampleDataset,
        *,
        seed: int = 0,
        shuffle: bool = True,
        rank: int = 0,
        world_size: int = 1,
    ) -> None:
        """See `EpochOrder` for seed, shuffle, rank and world_size; raises RadarError as it does."""
        self._samples = samples
        self._order = EpochOrder(len(samples), seed, shuffle, rank, world_size)
        epoch = torch.zeros((), dtype=torch.int64)
        self._epoch: torch.Tensor = epoch.share_memory_()  # type: ignore[no-untyped-call]  # seen by workers

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch that the next iteration goes through."""
        self._epoch.fill_(epoch)

    def __len__(self) -> int:
        return len(self._order)

    def __iter__(self) -> Iterator[Item]:
        worker = get_worker_info()
        first, step = (0, 1) if worker is None else (worker.id, worker.num_workers)
        for position in self._order.of(int(self._epoch))[first::step]:
            yield self._samples[int(position)]
