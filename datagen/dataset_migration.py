"""Bringing a dataset of an older version to the present one, file by file, so that an interrupted migration goes on.

Version 1: header and commit records carried no digest of their own. Version 2 seals them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from waveformer.datagen.dataset_files import COMMIT_FOLDER, HEADER_FILE, LOCK_FOLDER, read_json, write_json
from waveformer.datagen.dataset_layout import FORMAT, VERSION, DatasetLayout, sealed
from waveformer.datagen.dataset_store import COMMIT_FORMAT
from waveformer.simulator.errors import StoreError
from waveformer.simulator.file_lock import FileLock

OLDEST_VERSION = 1


def migrate_dataset(root: Path) -> int:
    """Rewrite what has an older version; the header comes last, so a dataset is of one version or still to be migrated.

    Returns:
        Number of files rewritten; 0 if everything was of this version.

    Raises:
        StoreError: there is no dataset, it is damaged, newer than this program, or somebody migrates it now.
    """
    path = root / HEADER_FILE
    try:
        header = read_json(path)
    except FileNotFoundError:
        raise StoreError(f"{root} is no dataset of waveformer generate or propose") from None
    if header.get("format") != FORMAT:
        raise StoreError(f"{path} is a {header.get('format')}, not a {FORMAT}")
    version = header.get("version")
    if version == VERSION:
        return 0
    if not isinstance(version, int) or not OLDEST_VERSION <= version < VERSION:
        raise StoreError(
            f"{path} has version {version}; this waveformer migrates {OLDEST_VERSION} to {VERSION}"
        )
    lock = FileLock(root / LOCK_FOLDER / "migration.lock")
    try:
        layout = DatasetLayout.from_json(header["layout"])
        rewritten = sum(
            _migrate_commit(record, layout) for record in sorted((root / COMMIT_FOLDER).glob("*.json"))
        )
        write_json(path, sealed({**header, "version": VERSION}))
        return rewritten + 1
    except (KeyError, TypeError) as error:
        raise StoreError(f"{path} is damaged: {error}") from None
    finally:
        lock.release()


def _migrate_commit(path: Path, layout: DatasetLayout) -> bool:
    record: dict[str, Any] = read_json(path)
    if record.get("format") != COMMIT_FORMAT or record.get("layout_sha256") != layout.sha256:
        raise StoreError(
            f"{path} is damaged or belongs to another dataset: remove it, and its shard is made again"
        )
    if record["version"] == VERSION:
        return False
    write_json(path, sealed({**record, "version": VERSION}))
    return True
