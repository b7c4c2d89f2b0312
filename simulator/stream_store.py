"""A scan larger than memory, written block by block; an interrupted run goes on where it stopped.

The hidden folder ``.<name>.unfinished`` holds, until the scan is complete,

    inputs.json     what determines H, so that nobody goes on with something else
    journal.jsonl   one line for every block whose bytes are on the disk, with their SHA-256
    store/          the store to be, without the attributes that make it one
    lock            of the one process that may write

A block counts once its line is in the journal. The finished store is byte for byte what `Measurement.save`
writes, however often the run was interrupted.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import StoreError
from waveformer.simulator.file_lock import FileLock
from waveformer.simulator.journal import Journal
from waveformer.simulator.measurement import (
    CHUNK_POSITIONS,
    H_DIMENSIONS,
    MEASUREMENT_FORMAT,
    SCHEMA_VERSION,
    measurement_attributes,
    plain_metadata,
    position_arrays,
)
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.storage import check_writable, flush, flush_tree, swap_in, unfinished_folder
from waveformer.simulator.zarr_store import add_array, create_array, seal, sha256_of

_STORE, _LOCK = "store", "lock"


class StreamWriter:
    """Takes H in blocks of consecutive rows, in any order. Made by `open`; a context manager."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        chirp: Chirp,
        aperture: Aperture,
        block_positions: int,
        overwrite: bool,
        lock: FileLock,
    ) -> None:
        """For `open`, which holds the lock and knows that the unfinished folder is of these inputs."""
        self._path, self._overwrite, self._lock = path, overwrite, lock
        self._chirp, self._aperture = chirp, aperture
        count = len(aperture)
        self._blocks = [
            slice(start, min(start + block_positions, count)) for start in range(0, count, block_positions)
        ]
        self._folder = unfinished_folder(path)
        self._group, self._h = _open_store(self._folder / _STORE, (count, chirp.num_samples))
        self._journal = Journal(self._folder / "journal.jsonl")
        # The last line counts, where a damaged block was written again.
        written = {entry["first_row"]: entry["sha256"] for entry in self._journal.entries}
        self._digests = {
            rows.start: written[rows.start]
            for rows in self._blocks
            if rows.start in written and self._read(rows, written[rows.start]) is not None
        }

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        chirp: Chirp,
        aperture: Aperture,
        inputs: Mapping[str, Any],
        *,
        block_positions: int = 8 * CHUNK_POSITIONS,
        overwrite: bool = False,
        resume: bool = False,
    ) -> Self:
        """Begin a scan, or go on with one.

        Args:
            path: where the store shall appear.
            chirp: T samples.
            aperture: N antenna pairs.
            inputs: all else that determines H, as JSON values by name: targets, materials, numerics, seed,
                front end, version; arrays and meshes by their `sha256_of`.
            block_positions: rows of a block, a multiple of 1024; the last one may be shorter.
            overwrite: replace an existing store in the end; without resume, also discard an unfinished one.
            resume: go on with the unfinished scan, if there is one. Blocks that are not as they were
                written are missing again.

        Raises:
            StoreError: the path may not be written, another process writes it, or the unfinished scan is
                of other inputs.
        """
        if block_positions < 1 or block_positions % CHUNK_POSITIONS:
            raise StoreError(
                f"block_positions must be a multiple of {CHUNK_POSITIONS}, got {block_positions!r}"
            )
        record = {
            **plain_metadata(inputs),
            "chirp": plain_metadata(dataclasses.asdict(chirp)),
            **{name: sha256_of(array.values) for name, array in position_arrays(aperture).items()},
            "block_positions": block_positions,
        }
        check_writable(path, overwrite, MEASUREMENT_FORMAT)
        with _disk_errors(path), ExitStack() as cleanup:
            lock = FileLock(unfinished_folder(path) / _LOCK)
            cleanup.callback(lock.release)
            check_writable(path, overwrite, MEASUREMENT_FORMAT)  # the lock's last owner may have finished
            _claim(path, record, overwrite, resume)
            writer = cls(path, chirp, aperture, block_positions, overwrite, lock)
            cleanup.pop_all()
        return writer

    def missing_blocks(self) -> list[slice]:
        """Rows of H still to be written, block by block."""
        return [rows for rows in self._blocks if rows.start not in self._digests]

    def write(self, first_row: int, h_block: NDArray[np.complexfloating[Any, Any]]) -> None:
        """Write one of the missing blocks; it is on the disk when this returns.

        Args:
            first_row: where the block starts.
            h_block: shape (rows, T), complex.

        Raises:
            StoreError: no such block is missing, it has another shape, or the disk refuses.
        """
        rows = next((rows for rows in self.missing_blocks() if rows.start == first_row), None)
        if rows is None:
            raise StoreError(f"{self._path}: no missing block starts at row {first_row}")
        expected = (rows.stop - rows.start, self._chirp.num_samples)
        if h_block.shape != expected or not np.iscomplexobj(h_block):
            raise StoreError(
                f"{self._path}: rows {rows.start} .. {rows.stop - 1} must be complex of shape {expected}, got "
                f"{h_block.dtype} {h_block.shape}"
            )
        values = np.ascontiguousarray(h_block, dtype=np.complex64)
        digest = sha256_of(values)
        with _disk_errors(self._path):
            self._h[rows] = values
            chunks = self._folder / _STORE / "h" / "c"
            for index in range(rows.start // CHUNK_POSITIONS, -(-rows.stop // CHUNK_POSITIONS)):
                flush_tree(chunks / str(index))
            flush(chunks)
            self._journal.append({"first_row": rows.start, "sha256": digest})
        self._digests[rows.start] = digest

    def finish(self, *, range_bias_m: float = 0.0, metadata: Mapping[str, Any] | None = None) -> None:
        """Read everything back, verify it, and publish it as a measurement.

        Args:
            range_bias_m: see `Measurement`.
            metadata: see `Measurement`. Without times in it, an interrupted run gives the same bytes.

        Raises:
            StoreError: blocks are missing, or no longer as they were written, or the disk refuses.
        """
        missing = len(self.missing_blocks())
        if missing:
            raise StoreError(f"{self._path}: {missing} of {len(self._blocks)} blocks are missing")
        attributes = measurement_attributes(self._chirp, float(range_bias_m), plain_metadata(metadata or {}))
        whole = hashlib.sha256()
        for rows in self._blocks:
            values = self._read(rows, self._digests[rows.start])
            if values is None:
                del self._digests[rows.start]
                raise StoreError(
                    f"{self._path}: rows {rows.start} .. {rows.stop - 1} are no longer as they were written: run again "
                    "with --resume (resume=True), which computes them anew"
                )
            whole.update(values.data)
        digests = {"h": whole.hexdigest()}
        with _disk_errors(self._path):
            for name, array in position_arrays(self._aperture).items():
                add_array(self._group, name, array)
                digests[name] = sha256_of(array.values)
            seal(self._group, MEASUREMENT_FORMAT, SCHEMA_VERSION, attributes, digests)
            flush_tree(self._folder / _STORE)
            check_writable(self._path, self._overwrite, MEASUREMENT_FORMAT)
            swap_in(self._folder / _STORE, Path(os.path.realpath(self._path)))
        shutil.rmtree(self._folder, ignore_errors=True)
        self.close()

    def close(self) -> None:
        """Let other processes go on with an unfinished scan; a second call does nothing."""
        self._journal.close()
        self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _read(self, rows: slice, digest: str) -> NDArray[np.complex64] | None:
        """Rows of H from the disk, or None if they are not those of the digest."""
        try:
            values = np.ascontiguousarray(self._h[rows])
        except (OSError, ValueError):  # unreadable, of a wrong length, or of a wrong CRC-32C
            return None
        return values if sha256_of(values) == digest else None


def _claim(path: str | os.PathLike[str], record: Mapping[str, Any], overwrite: bool, resume: bool) -> None:
    """Make the unfinished folder one of these inputs, empty unless it is resumed."""
    folder = unfinished_folder(path)
    inputs = folder / "inputs.json"
    begun = json.loads(inputs.read_text()) if inputs.exists() else None
    if begun is not None and resume:
        differing = sorted(
            name for name in begun.keys() | record.keys() if begun.get(name) != record.get(name)
        )
        if differing:
            raise StoreError(
                f"{path} was begun with different {', '.join(differing)}: resume with the same inputs, or start anew "
                "with --force (overwrite=True) and without --resume"
            )
        return
    if begun is not None and not overwrite:
        raise StoreError(
            f"{path} is unfinished: go on with --resume (resume=True), or start anew with --force (overwrite=True)"
        )
    # First, because a folder without inputs is no scan.
    inputs.unlink(missing_ok=True)
    flush(folder)
    for name in os.listdir(folder):
        if (folder / name).is_dir():
            shutil.rmtree(folder / name)
        elif name != _LOCK:
            (folder / name).unlink()
    draft = folder / "inputs.draft"
    draft.write_text(json.dumps(record))
    flush(draft)
    os.replace(draft, inputs)
    flush(folder)


def _open_store(folder: Path, shape: tuple[int, int]) -> tuple[Any, Any]:
    """The Zarr group and its array h, with the chunks that are there and metadata written afresh."""
    import zarr

    for pattern in ("zarr.json", "*.partial"):  # zarr writes files by that suffix, then renames them
        for leftover in folder.rglob(pattern):
            leftover.unlink()
    group = zarr.create_group(folder, zarr_format=3)
    chunks = (CHUNK_POSITIONS, shape[1])
    return group, create_array(group, "h", shape, np.complex64, H_DIMENSIONS, chunks)


@contextmanager
def _disk_errors(path: str | os.PathLike[str]) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(
            f"cannot write {path}: {error.strerror or error}; blocks written before are kept: when that is mended, "
            "run again with --resume (resume=True)"
        ) from error
