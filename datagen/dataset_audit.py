"""Checking and tidying a dataset: what is there, what is damaged, and what a killed run left behind."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from waveformer.datagen.dataset_files import (
    ARRAYS_FOLDER,
    COMMIT_FOLDER,
    TEMPORARY_SUFFIX,
    commit_path,
    lock_path,
    shard_file,
)
from waveformer.datagen.dataset_layout import DatasetLayout
from waveformer.datagen.dataset_store import COMMITTED, read_commit, read_header, read_layout
from waveformer.simulator.errors import StoreError
from waveformer.simulator.file_lock import FileLock


@dataclass(frozen=True)
class Audit:
    """State of a dataset; requested = committed + quarantined + pending, always.

    Attributes:
        requested, committed, quarantined, pending: samples.
        damaged: files that differ from what was committed, each with what is wrong.
        strays: files that no commit record names.
    """

    requested: int
    committed: int
    quarantined: int
    pending: int
    damaged: tuple[str, ...]
    strays: tuple[Path, ...]

    @property
    def balance(self) -> str:
        """The invariant as a sentence."""
        return (
            f"{self.requested} requested = {self.committed} committed + {self.quarantined} quarantined + "
            f"{self.pending} pending"
        )


def audit(root: Path, progress: Callable[[int, int], None] | None = None) -> Audit:
    """Verify every committed byte.

    Args:
        root: of the dataset.
        progress: called with (shards done, shards).

    Raises:
        StoreError: there is no dataset, or its header is damaged.
    """
    layout = read_layout(root)
    damaged = _damaged_tables(root, layout)
    committed = quarantined = 0
    known: set[str] = set()
    for shard in range(layout.num_shards):
        if progress is not None:
            progress(shard, layout.num_shards)
        try:
            record = read_commit(root, layout, shard)
        except StoreError as error:
            damaged.append(str(error))
            continue
        if record is None:
            continue
        statuses = [item["status"] for item in record["samples"]]
        if [item["index"] for item in record["samples"]] != list(layout.samples_of(shard)):
            damaged.append(f"{commit_path(root, shard)} does not list the samples of its shard")
            continue
        committed += statuses.count(COMMITTED)
        quarantined += len(statuses) - statuses.count(COMMITTED)
        for name, expected in record["files"].items():
            known.add(name)
            if problem := _problem(root / name, expected["bytes"], expected["sha256"]):
                damaged.append(f"{root / name} {problem}")
    if progress is not None:
        progress(layout.num_shards, layout.num_shards)
    strays = tuple(
        path for path in _data_files(root, layout) if path.relative_to(root).as_posix() not in known
    )
    pending = layout.num_samples - committed - quarantined
    return Audit(layout.num_samples, committed, quarantined, pending, tuple(damaged), strays)


def sweep(root: Path) -> list[Path]:
    """Remove temporary files and shards that were never committed; shards that somebody makes now are left alone.

    Returns:
        What was removed.

    Raises:
        StoreError: there is no dataset.
    """
    layout = read_layout(root)
    removed = []
    for shard in range(layout.num_shards):
        if commit_path(root, shard).exists():
            continue
        try:
            lock = FileLock(lock_path(root, shard))
        except StoreError:
            continue
        try:
            if not commit_path(root, shard).exists():
                removed += [path for path in _shard_paths(root, layout, shard) if _removed(path)]
        finally:
            lock.release()
    folders = [root / COMMIT_FOLDER, root / ARRAYS_FOLDER]
    for folder in folders:
        removed += [path for path in folder.rglob(f"*{TEMPORARY_SUFFIX}") if _removed(path)]
    for path in root.parent.glob(f".{root.name}.*{TEMPORARY_SUFFIX}"):
        shutil.rmtree(path, ignore_errors=True)
        removed.append(path)
    return removed


def withdraw(root: Path, shards: list[int]) -> None:
    """Take back the commit of shards, so that the next run makes them again.

    Raises:
        StoreError: somebody is making one of them.
    """
    for shard in shards:
        lock = FileLock(lock_path(root, shard))
        try:
            commit_path(root, shard).unlink(missing_ok=True)
        finally:
            lock.release()


def damaged_shards(root: Path, layout: DatasetLayout) -> list[int]:
    """Shards whose record or files differ from what was committed."""
    found = []
    for shard in range(layout.num_shards):
        try:
            record = read_commit(root, layout, shard)
        except StoreError:
            found.append(shard)
            continue
        if record is not None and any(
            _problem(root / name, expected["bytes"], expected["sha256"])
            for name, expected in record["files"].items()
        ):
            found.append(shard)
    return found


def quarantined_shards(root: Path, layout: DatasetLayout) -> list[int]:
    """Shards in which a sample was given up; raises StoreError if a record is damaged."""
    found = []
    for shard in range(layout.num_shards):
        record = read_commit(root, layout, shard)
        if record is not None and any(item["status"] != COMMITTED for item in record["samples"]):
            found.append(shard)
    return found


def _damaged_tables(root: Path, layout: DatasetLayout) -> list[str]:
    expected = {**layout.tables, **read_header(root)["provenance"].get("metadata_sha256", {})}
    return [
        f"{root / name} {problem}"
        for name, digest in expected.items()
        if (problem := _problem(root / name, None, digest))
    ]


def _problem(path: Path, size: int | None, digest: str) -> str:
    """What is wrong with a file; "" if nothing."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return "is missing"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if size is not None and len(content) != size:
        return f"has {len(content)} bytes, not {size}"
    return "" if hashlib.sha256(content).hexdigest() == digest else "differs from what was committed"


def _data_files(root: Path, layout: DatasetLayout) -> list[Path]:
    return sorted(
        path
        for info in layout.arrays
        for path in (root / ARRAYS_FOLDER / info.name / "c").rglob("*")
        if path.is_file()
    )


def _shard_paths(root: Path, layout: DatasetLayout, shard: int) -> list[Path]:
    return [root / shard_file(info.name, shard, len(info.shape)) for info in layout.arrays]


def _removed(path: Path) -> bool:
    try:
        path.unlink()
    except FileNotFoundError:
        return False
    return True
