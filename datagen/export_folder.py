"""Exports that consist of many files: collected under a hidden name, so that an interrupted one goes on.

OUT/export.json      what it is: arrays, dimensions, units, settings, versions
OUT/radar.npz        frequencies and antenna positions, where signals are exported
OUT/samples/         the samples
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from waveformer.datagen.dataset_files import read_json, write_json
from waveformer.datagen.export_choice import EXPORT_FORMAT, ExportChoice
from waveformer.simulator.errors import StoreError
from waveformer.simulator.file_lock import FileLock
from waveformer.simulator.storage import flush_tree, publish_file, swap_in, unfinished_folder

DESCRIPTION_FILE, RADAR_FILE, SAMPLES_FOLDER = "export.json", "radar.npz", "samples"
_LOCK = "lock"


@contextmanager
def collected(
    out: Path, choice: ExportChoice, settings: Mapping[str, Any], *, overwrite: bool = False
) -> Iterator[Path]:
    """Collect the files of an export; the folder appears at `out` when the block ends well.

    After an interruption the same call finds the files that were complete.

    Args:
        out: where the export shall appear.
        choice: what is exported.
        settings: what else determines the files, JSON values.
        overwrite: replace an export, and discard an unfinished one of other settings.

    Yields:
        The folder for the samples' files; write them with `simulator.storage.publish_file`.

    Raises:
        StoreError: something is there that may not be replaced, an unfinished export of other settings is there,
            another process exports to the same place, or it cannot be written.
    """
    description = {**choice.describe(), **settings}
    check_export_writable(out, overwrite)
    folder = unfinished_folder(out)
    try:
        lock = FileLock(folder / _LOCK)
        try:
            _prepare(folder, out, description, overwrite)
            if radar := choice.radar():
                with publish_file(folder / RADAR_FILE, overwrite=True) as path:
                    np.savez(path, **radar)  # type: ignore[arg-type]
            yield folder / SAMPLES_FOLDER
            check_export_writable(out, overwrite)  # another process may have written meanwhile
            flush_tree(folder)
            target = Path(os.path.realpath(out))
            swap_in(folder, target)
            (target / _LOCK).unlink()  # held until here, so that nobody else collects in this folder
        finally:
            lock.release()
    except OSError as error:
        raise StoreError(f"cannot write {out}: {error.strerror or error}") from error


def check_export_writable(out: Path, overwrite: bool) -> None:
    """Raise StoreError unless an export can be published at `out`: only an export is ever replaced."""
    if not os.path.lexists(out):
        return
    try:
        found = read_json(out / DESCRIPTION_FILE).get("format") if out.is_dir() else None
    except (FileNotFoundError, StoreError):
        found = None
    if found != EXPORT_FORMAT:
        raise StoreError(f"{out} exists and is not an export, so it is never replaced: choose another path")
    if not overwrite:
        raise StoreError(f"{out} exists; pass --force (overwrite=True) to replace it")


def _prepare(folder: Path, out: Path, description: dict[str, Any], overwrite: bool) -> None:
    """Make the unfinished folder one of this export, with the files that are complete."""
    path = folder / DESCRIPTION_FILE
    try:
        other = read_json(path) != description
    except FileNotFoundError:
        other = False
    if other and not overwrite:
        raise StoreError(
            f"an unfinished export of other samples or settings lies in {folder}: repeat its command, or discard it "
            "with --force (overwrite=True)"
        )
    if other:
        shutil.rmtree(folder / SAMPLES_FOLDER, ignore_errors=True)
    (folder / SAMPLES_FOLDER).mkdir(exist_ok=True)
    for parent in (folder, folder / SAMPLES_FOLDER):
        for left in parent.glob(".*.partial"):  # by a run that was killed
            shutil.rmtree(left, ignore_errors=True)
    write_json(path, description)
