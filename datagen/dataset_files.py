"""Where the files of a dataset lie, and how small ones are written so that they are complete or not there."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from waveformer.simulator.errors import StoreError
from waveformer.simulator.storage import flush

HEADER_FILE = "dataset.json"
ARRAYS_FOLDER = "samples.zarr"
COMMIT_FOLDER = "commit"
LOCK_FOLDER = ".locks"
TEMPORARY_SUFFIX = ".partial"


def commit_path(root: Path, shard: int) -> Path:
    """The record that makes a shard part of the dataset."""
    return root / COMMIT_FOLDER / f"{shard:06d}.json"


def lock_path(root: Path, shard: int) -> Path:
    """Held by whoever makes a shard."""
    return root / LOCK_FOLDER / f"{shard:06d}.lock"


def shard_file(name: str, shard: int, num_axes: int) -> str:
    """Path of the file that holds a shard of an array, relative to the dataset (Zarr v3 default chunk keys).

    Args:
        name: of the array.
        shard: number.
        num_axes: of one sample.
    """
    return "/".join([ARRAYS_FOLDER, name, "c", str(shard), *["0"] * num_axes])


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write JSON and wait until it is on the disk; a reader sees all of it or the file before.

    Raises:
        OSError: it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY_SUFFIX}")
    try:
        temporary.write_text(
            json.dumps(values, sort_keys=True, indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )
        flush(temporary)
        os.replace(temporary, path)
        flush(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def read_json(path: Path) -> dict[str, Any]:
    """JSON values of a file.

    Raises:
        FileNotFoundError: there is none.
        StoreError: it cannot be read, or holds something else.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {error.strerror}") from None
    except ValueError:
        raise StoreError(f"{path} is damaged: not JSON") from None
    if not isinstance(values, dict):
        raise StoreError(f"{path} is damaged: not a JSON object")
    return values
