"""Making all shards of a dataset that are missing: in this process, or by the workers of a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from waveformer.datagen.dataset_store import read_commit, read_layout
from waveformer.datagen.factory_shard import ShardMaker, ShardReceipt, receipt_of
from waveformer.simulator.errors import RadarError

# How often shards that another run makes are looked at.
_POLL_S = 1.0


@dataclass(frozen=True)
class Partition:
    """A part of the shards, for job arrays: those whose number leaves `index` on division by `count`.

    Attributes:
        index: 0 .. count - 1.
        count: parts.
    """

    index: int = 0
    count: int = 1

    def __post_init__(self) -> None:
        if not (self.count >= 1 and 0 <= self.index < self.count):
            raise RadarError(f"shard-index must lie in 0 .. num-shards - 1, got {self.index} of {self.count}")


@dataclass
class RunState:
    """How far a run has come.

    Attributes:
        requested: samples of this partition.
        committed, quarantined: of these, there by now.
        written: samples made by this run.
        started: when, on the clock of time.perf_counter.
    """

    requested: int = 0
    committed: int = 0
    quarantined: int = 0
    written: int = 0
    started: float = field(default_factory=time.perf_counter)

    @property
    def done(self) -> int:
        """Samples that are settled."""
        return self.committed + self.quarantined

    @property
    def pending(self) -> int:
        """Samples still to be made."""
        return self.requested - self.done

    @property
    def samples_per_hour(self) -> float:
        """Of this run."""
        return 3600.0 * self.written / max(time.perf_counter() - self.started, 1e-9)

    @property
    def balance(self) -> str:
        """The invariant as a sentence."""
        return (
            f"{self.requested} requested = {self.committed} committed + {self.quarantined} quarantined + "
            f"{self.pending} pending"
        )


def run_factory(
    root: Path,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    partition: Partition | None = None,
    progress: Callable[[RunState], None] | None = None,
) -> RunState:
    """Make every sample that is not there yet; the same call goes on where an interrupted one stopped.

    Runs on one dataset at the same time share its shards.

    Args:
        root: of a dataset.
        workers: processes on this machine, each with one thread; 1 works without Dask.
        scheduler: address of a Dask scheduler, whose workers must see `root` under the same path; instead of `workers`.
        partition: the part of the shards to make; None means all.
        progress: called at the beginning and after each shard.

    Raises:
        RadarError: fewer than one worker.
        StoreError: there is no dataset, it is damaged, or it cannot be written.
        SetupError: the ray tracer is missing or broken, or Dask is.
    """
    if workers < 1:
        raise RadarError(f"workers must be at least 1, got {workers}")
    layout = read_layout(root)
    part = partition or Partition()
    shards = list(range(part.index, layout.num_shards, part.count))
    state = RunState(requested=sum(len(layout.samples_of(shard)) for shard in shards))
    missing = []
    for shard in shards:
        record = read_commit(root, layout, shard)
        if record is None:
            missing.append(shard)
        else:
            _count(state, receipt_of(shard, record))
    if progress is not None:
        progress(state)
    while missing:
        busy = []
        for receipt in _receipts(root, missing, workers, scheduler):
            if receipt.busy:
                busy.append(receipt.shard)
                continue
            _count(state, receipt)
            if progress is not None:
                progress(state)
        if len(busy) == len(missing):
            time.sleep(_POLL_S)  # others make them; if they die, their locks fall and this run goes on
        missing = busy
    return state


def _receipts(root: Path, shards: list[int], workers: int, scheduler: str | None) -> Iterator[ShardReceipt]:
    if workers > 1 or scheduler is not None:
        from waveformer.datagen.factory_cluster import make_on_cluster

        yield from make_on_cluster(root, shards, workers, scheduler)
        return
    with closing(ShardMaker(root)) as maker:
        yield from map(maker.make, shards)


def _count(state: RunState, receipt: ShardReceipt) -> None:
    state.committed += receipt.committed
    state.quarantined += receipt.quarantined
    if receipt.written:
        state.written += receipt.committed + receipt.quarantined
