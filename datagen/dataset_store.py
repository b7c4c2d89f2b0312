"""Writing a dataset: created whole, then shard by shard, each committed only after it was read back.

    STORE/dataset.json          layout, sealed
    STORE/<table>               what the maker reads, e.g. objects.jsonl
    STORE/samples.zarr/         Zarr v3, sharded along the first axis, a CRC-32C of every sample
    STORE/commit/<shard>.json   size and SHA-256 of the shard's files, record of every sample, sealed

Commit protocol: arrays -> flushed -> read back -> record -> flushed -> renamed. Nothing counts without its record.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_files import (
    ARRAYS_FOLDER,
    COMMIT_FOLDER,
    HEADER_FILE,
    TEMPORARY_SUFFIX,
    commit_path,
    read_json,
    shard_file,
    write_json,
)
from waveformer.datagen.dataset_layout import FORMAT, VERSION, DatasetLayout, sealed, unsealed
from waveformer.simulator.errors import StoreError
from waveformer.simulator.storage import flush, flush_tree

COMMIT_FORMAT = "waveformer.commit"
COMMITTED, QUARANTINED = "committed", "quarantined"


@dataclass(frozen=True, eq=False)
class MadeSample:
    """One sample of a shard, made or given up.

    Attributes:
        index: in the dataset.
        arrays: by name, shape of one sample; None if it was given up.
        record: all that is needed to make it again, JSON values.
        reason: why it was given up, one line; "" otherwise.
    """

    index: int
    arrays: Mapping[str, NDArray[Any]] | None
    record: Mapping[str, Any]
    reason: str = ""


def create_dataset(
    root: Path, layout: DatasetLayout, tables: Mapping[str, bytes], provenance: Mapping[str, Any]
) -> None:
    """Create an empty dataset, or accept the one that is there.

    Args:
        root: its folder.
        layout: what two runs must agree on.
        tables: content of the files named in `layout.tables`.
        provenance: versions and the like, kept but not compared.

    Raises:
        StoreError: something else is there, a dataset of another layout, or it cannot be written.
    """
    from waveformer.datagen.dataset_zarr import create_arrays

    if (root / HEADER_FILE).exists():
        _require_equal(root, read_layout(root), layout)
        return
    if root.exists() and any(root.iterdir()):
        raise StoreError(f"{root} is not empty and holds no dataset: choose another folder")
    try:
        root.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{root.name}.", suffix=TEMPORARY_SUFFIX, dir=root.parent))
        try:
            temporary.chmod(0o755)
            create_arrays(temporary / ARRAYS_FOLDER, layout)
            (temporary / COMMIT_FOLDER).mkdir()
            for name, content in tables.items():
                (temporary / name).write_bytes(content)
            header = {
                "format": FORMAT,
                "version": VERSION,
                "layout": layout.to_json(),
                "provenance": dict(provenance),
            }
            write_json(temporary / HEADER_FILE, sealed(header))
            flush_tree(temporary)
            temporary.rename(
                root
            )  # fails if another run was first: an empty folder gives way, a full one does not
            flush(root.parent)
        except OSError:
            if not (root / HEADER_FILE).exists():
                raise
            _require_equal(root, read_layout(root), layout)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise StoreError(f"cannot create {root}: {error.strerror or error}") from error


def read_layout(root: Path) -> DatasetLayout:
    """The layout of a dataset.

    Raises:
        StoreError: there is none, it is damaged, or its version is another.
    """
    return DatasetLayout.from_json(read_header(root)["layout"])


def read_header(root: Path) -> dict[str, Any]:
    """dataset.json, verified; raises as `read_layout`."""
    path = root / HEADER_FILE
    try:
        values = read_json(path)
    except FileNotFoundError:
        raise StoreError(f"{root} is no dataset of waveformer generate or propose") from None
    if values.get("format") != FORMAT:
        raise StoreError(f"{path} is a {values.get('format')}, not a {FORMAT}")
    version = values.get("version")
    if not isinstance(version, int) or version > VERSION:
        raise StoreError(f"{path} has version {version}; this waveformer reads up to {VERSION}: upgrade")
    if version < VERSION:
        raise StoreError(f"{path} has version {version}: run waveformer dataset migrate {root}")
    try:
        return unsealed(values)
    except ValueError as error:
        raise StoreError(f"{path} is damaged: {error}") from None


def write_shard(root: Path, layout: DatasetLayout, shard: int, samples: Sequence[MadeSample]) -> None:
    """Write and commit a shard; whoever calls it holds the shard's lock.

    Args:
        root: of the dataset.
        layout: of the dataset.
        shard: number.
        samples: all of the shard, ascending.

    Raises:
        StoreError: the samples are not those of the shard, or what was read back differs.
        OSError: it cannot be written.
    """
    from waveformer.datagen.dataset_zarr import write_rows

    indices = layout.samples_of(shard)
    if [sample.index for sample in samples] != list(indices):
        raise StoreError(f"shard {shard} consists of samples {indices.start} .. {indices.stop - 1}")
    files = {}
    for info in layout.arrays:
        block = info.empty(len(samples))
        for row, sample in enumerate(samples):
            if sample.arrays is not None:
                block[row] = _checked(info.name, sample.arrays[info.name], info.shape)
        name = shard_file(info.name, shard, len(info.shape))
        write_rows(root, info, shard, indices, block)
        if (root / name).exists():  # none where all samples were given up
            flush(root / name)
            flush((root / name).parent)
            content = (root / name).read_bytes()
            files[name] = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    record = {
        "format": COMMIT_FORMAT,
        "version": VERSION,
        "layout_sha256": layout.sha256,
        "shard": shard,
        "files": files,
        "samples": [_described(sample) for sample in samples],
    }
    write_json(commit_path(root, shard), sealed(record))


def read_commit(root: Path, layout: DatasetLayout, shard: int) -> dict[str, Any] | None:
    """The record of a committed shard; None if it is not committed.

    Raises:
        StoreError: the record is damaged or belongs to another dataset.
    """
    path = commit_path(root, shard)
    try:
        record = unsealed(read_json(path))
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise StoreError(f"{path} is damaged: {error}") from None
    expected = (COMMIT_FORMAT, VERSION, layout.sha256, shard)
    if tuple(record.get(key) for key in ("format", "version", "layout_sha256", "shard")) != expected:
        raise StoreError(f"{path} belongs to another dataset or version")
    return record


def _described(sample: MadeSample) -> dict[str, Any]:
    status = COMMITTED if sample.arrays is not None else QUARANTINED
    return {"index": sample.index, "status": status, "reason": sample.reason, "record": dict(sample.record)}


def _checked(name: str, values: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    found = np.asarray(values)
    if found.shape != shape:
        raise StoreError(f"array {name} of a sample has shape {found.shape}, not {shape}")
    return found


def _require_equal(root: Path, found: DatasetLayout, expected: DatasetLayout) -> None:
    from waveformer.datagen.twin_store import difference

    if different := difference(found.to_json(), expected.to_json()):
        raise StoreError(
            f"{root} holds a dataset of other settings ({different}): choose another folder, or repeat the settings"
        )
