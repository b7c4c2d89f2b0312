"""Making one shard: its samples one by one in a sandbox, then all of them committed together."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from waveformer.datagen.dataset_files import lock_path
from waveformer.datagen.dataset_layout import DatasetLayout
from waveformer.datagen.dataset_store import (
    COMMITTED,
    MadeSample,
    read_commit,
    read_layout,
    write_shard,
)
from waveformer.datagen.sandbox import Sandbox, SandboxError
from waveformer.simulator.errors import MeshError, RadarError, StoreError
from waveformer.simulator.file_lock import FileLock

# A poison sample kills its sandbox every time, a machine out of memory only once.
TRIES = 2


@dataclass(frozen=True)
class ShardReceipt:
    """What became of a shard.

    Attributes:
        shard: number.
        committed, quarantined: samples.
        written: whether this call made it.
        busy: whether another process is making it; then nothing else is known.
        seconds: that it took.
    """

    shard: int
    committed: int = 0
    quarantined: int = 0
    written: bool = False
    busy: bool = False
    seconds: float = 0.0


class ShardMaker:
    """Makes shards of one dataset, one after the other, with a sandbox that lives as long as it does.

    The layout's maker is a function (root: str, index: int) -> (arrays by name, record as JSON values). What it raises as
    MeshError or RadarError gives the sample up; what kills it, hangs or fills the memory does so after two tries.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.layout: DatasetLayout = read_layout(root)
        self._sandbox = Sandbox(
            self.layout.maker,
            time_limit_s=self.layout.time_limit_s,
            memory_limit_bytes=self.layout.memory_limit_bytes,
        )

    def make(self, shard: int) -> ShardReceipt:
        """Make and commit a shard that is not there yet.

        Raises:
            StoreError: it cannot be written, or its record is damaged.
            SetupError: the sandbox cannot start.
        """
        started = time.perf_counter()
        try:
            lock = FileLock(lock_path(self.root, shard))
        except StoreError:
            return ShardReceipt(shard, busy=True)
        except OSError as error:
            raise StoreError(f"cannot write {self.root}: {error.strerror}") from error
        try:
            if (record := read_commit(self.root, self.layout, shard)) is not None:
                return receipt_of(shard, record)
            samples = [self._sample(index) for index in self.layout.samples_of(shard)]
            write_shard(self.root, self.layout, shard, samples)
            committed = sum(sample.arrays is not None for sample in samples)
            seconds = time.perf_counter() - started
            return ShardReceipt(shard, committed, len(samples) - committed, written=True, seconds=seconds)
        except OSError as error:
            raise StoreError(
                f"cannot write {self.root}: {error.strerror or error}; nothing committed is lost"
            ) from error
        finally:
            lock.release()

    def close(self) -> None:
        """End the sandbox."""
        self._sandbox.close()

    def _sample(self, index: int) -> MadeSample:
        for attempt in range(1, TRIES + 1):
            try:
                arrays, record = self._sandbox.call(str(self.root), index)
                return MadeSample(index, arrays, record)
            except (MeshError, RadarError) as error:
                return MadeSample(index, None, {}, str(error))
            except SandboxError as error:
                if attempt == TRIES:
                    return MadeSample(index, None, {}, f"{error} (tried {TRIES} times)")
        raise AssertionError("unreachable")


def receipt_of(shard: int, record: Mapping[str, Any]) -> ShardReceipt:
    """What became of a committed shard, from its record."""
    committed = sum(item["status"] == COMMITTED for item in record["samples"])
    return ShardReceipt(shard, committed, len(record["samples"]) - committed)
