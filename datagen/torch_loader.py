"""A recipe for training: batches from spawned workers, in an order that an interrupted run goes on with."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

import torch.distributed
from torch.utils.data import DataLoader, Sampler

from waveformer.datagen.epoch_order import EpochOrder
from waveformer.datagen.torch_dataset import Item, SampleDataset
from waveformer.simulator.errors import StoreError


class EpochSampler(Sampler[int]):
    """Positions in the order of the current epoch, from the place where training is.

    Attributes:
        epoch: the current one.
        position: samples of it that were trained on.
    """

    def __init__(self, order: EpochOrder) -> None:
        self.order = order
        self.epoch = 0
        self.position = 0

    def __len__(self) -> int:
        return len(self.order) - self.position

    def __iter__(self) -> Iterator[int]:
        return iter(self.order.of(self.epoch)[self.position :].tolist())

    def set_epoch(self, epoch: int) -> None:
        """Go to the beginning of an epoch; what was trained of the current one stays if it is that."""
        if epoch != self.epoch:
            self.epoch, self.position = epoch, 0


class TrainingLoader:
    """Batches of a `SampleDataset`; each iteration is one epoch, the next one follows by itself.

    An epoch that is left early begins again, unless `load_state_dict` puts the loader inside it. The state counts the
    batches that were handed out, not those that workers have read ahead.
    """

    def __init__(
        self,
        samples: SampleDataset,
        sampler: EpochSampler,
        *,
        batch_size: int,
        num_workers: int,
        drop_last: bool,
    ) -> None:
        """For `data_loader`."""
        self.samples = samples
        self.sampler = sampler
        self._batch_size, self._drop_last = batch_size, drop_last
        self._resumed = False
        self._batches = DataLoader(
            samples,
            batch_size=batch_size,
            sampler=sampler,
            num_workers=num_workers,
            drop_last=drop_last,
            multiprocessing_context="spawn" if num_workers else None,
            persistent_workers=num_workers > 0,  # a spawned worker takes seconds to start
        )

    def __len__(self) -> int:
        """Batches that the next iteration yields."""
        left = len(self.sampler.order) - (self.sampler.position if self._resumed else 0)
        return left // self._batch_size if self._drop_last else -(-left // self._batch_size)

    def __iter__(self) -> Iterator[Item]:
        if not self._resumed:
            self.sampler.position = 0
        self._resumed = False
        for batch in self._batches:
            self.sampler.position += len(batch["index"])
            yield batch
        self.sampler.set_epoch(self.sampler.epoch + 1)

    def set_epoch(self, epoch: int) -> None:
        """Choose the epoch that the next iteration goes through."""
        self.sampler.set_epoch(epoch)

    def state_dict(self) -> dict[str, Any]:
        """Where training is, plain values: to be saved with a checkpoint."""
        return {"epoch": self.sampler.epoch, "position": self.sampler.position, "order": self._identity()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on where `state_dict` was taken.

        Raises:
            StoreError: the state belongs to other samples, another seed or another number of processes.
        """
        found, expected = dict(state["order"]), self._identity()
        if different := sorted(key for key in expected if found.get(key) != expected[key]):
            raise StoreError(
                f"cannot resume inside an epoch: {', '.join(different)} differ from the checkpoint's; "
                "start the epoch anew with set_epoch"
            )
        self.sampler.epoch, self.sampler.position = int(state["epoch"]), int(state["position"])
        self._resumed = True

    def _identity(self) -> dict[str, Any]:
        order = self.sampler.order
        return {
            "samples_sha256": hashlib.sha256(self.samples.indices.tobytes()).hexdigest(),
            "seed": order.seed,
            "shuffle": order.shuffle,
            "world_size": order.world_size,
        }


def data_loader(
    samples: SampleDataset,
    *,
    batch_size: int,
    num_workers: int = 2,
    seed: int = 0,
    shuffle: bool = True,
    drop_last: bool = False,
    rank: int | None = None,
    world_size: int | None = None,
) -> TrainingLoader:
    """Batches for training or evaluation.

    A script that uses workers needs `if __name__ == "__main__":` around what it runs, as always with spawn.

    Args:
        samples: what to load.
        batch_size: samples a batch, in each process.
        num_workers: processes that read; 0 reads in this one.
        seed: of the order.
        shuffle: whether each epoch has an order of its own.
        drop_last: leave out an incomplete last batch.
        rank, world_size: of data-parallel training, see `EpochOrder`; None means those of torch.distributed where it
            is initialised, else one process.

    Raises:
        RadarError: rank and world_size do not fit each other, or there are too few samples.
    """
    started = torch.distributed.is_available() and torch.distributed.is_initialized()
    if rank is None:
        rank = torch.distributed.get_rank() if started else 0
    if world_size is None:
        world_size = torch.distributed.get_world_size() if started else 1
    order = EpochOrder(len(samples), seed, shuffle, rank, world_size)
    return TrainingLoader(
        samples, EpochSampler(order), batch_size=batch_size, num_workers=num_workers, drop_last=drop_last
    )
