"""The order in which an epoch of training visits the samples: a function of seed and epoch, nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_streams import generator


@dataclass(frozen=True)
class EpochOrder:
    """Positions 0 .. count - 1 in the order of each epoch, as one of several training processes visits them.

    Shuffled, all processes get the same number, so that none waits for another: up to world_size - 1 samples are left
    out, others in each epoch. Not shuffled, every sample comes exactly once, as an evaluation needs it.

    Attributes:
        count: samples.
        seed: of the order.
        shuffle: False keeps them ascending.
        rank, world_size: this process and the number of processes.
    """

    count: int
    seed: int = 0
    shuffle: bool = True
    rank: int = 0
    world_size: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.rank < self.world_size:
            raise RadarError(f"rank must lie in 0 .. world_size - 1, got {self.rank} of {self.world_size}")
        if len(self) < 1:
            raise RadarError(f"{self.count} samples are too few for {self.world_size} processes")

    def __len__(self) -> int:
        if self.shuffle:
            return self.count // self.world_size
        return len(range(self.rank, self.count, self.world_size))

    def of(self, epoch: int) -> NDArray[np.int64]:
        """Positions of this process in an epoch, shape (len(self),)."""
        if not self.shuffle:
            return np.arange(self.rank, self.count, self.world_size, dtype=np.int64)
        order = generator(self.seed, f"order of epoch {epoch}").permutation(self.count)
        return np.asarray(order[self.rank :: self.world_size][: len(self)], dtype=np.int64)
