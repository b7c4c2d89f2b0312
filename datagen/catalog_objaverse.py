"""Objaverse 1.0: ``hf-objaverse-v1/glbs/000-NNN/<uid>.glb`` with its index files, all from Sketchfab.

``lvis-annotations.json.gz`` names the category of some objects, ``metadata/000-NNN.json.gz`` the licence of
those in the folder of the same number. Both may be missing; ``object-paths.json.gz`` is not needed.
"""

from __future__ import annotations

import gzip
import json
import re
import zlib
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

from waveformer.datagen.catalog_items import CatalogItem, walk_files
from waveformer.simulator.errors import StoreError

_UID = re.compile(r"[0-9a-f]{32}")
_NO_UID = "its name is no Sketchfab uid (32 hexadecimal digits): scan such files with --source folder"
_MAX_INDEX_BYTES = 1_000_000_000


def read_objaverse(root: Path) -> Iterator[CatalogItem]:
    """One object for each GLB in a folder below ``glbs``; y up, nominally metres but of any scale.

    Raises:
        StoreError: there is no such file, or an index file is damaged.
    """
    found_any = found_index = False
    categories: dict[Path, dict[str, str]] = {}
    for folder, files in groupby(walk_files(root), lambda found: found.parts[:-1]):
        licences: dict[str, str] | None = None
        for found in files:
            found_index |= found.name in ("object-paths.json.gz", "lvis-annotations.json.gz")
            if found.suffix != "glb":
                continue
            found_any = True
            base, shard = _place(root, folder)
            if licences is None:
                licences = _licences(base / "metadata" / f"{shard}.json.gz")
            if base not in categories:
                categories[base] = _categories(base / "lvis-annotations.json.gz")
            uid = found.stem
            yield CatalogItem(
                "objaverse",
                uid,
                found.path,
                category=categories[base].get(uid, ""),
                licence=licences.get(uid, ""),
                up_axis="y",
                reason=found.reason or ("" if _UID.fullmatch(uid) else _NO_UID),
            )
    if not found_any:
        hint = (
            "it holds the index files only: download objects first"
            if found_index
            else "give hf-objaverse-v1 or its glbs"
        )
        raise StoreError(f"{root} holds no Objaverse object (glbs/000-NNN/<uid>.glb): {hint}")


def _place(root: Path, folder: tuple[str, ...]) -> tuple[Path, str]:
    """The folder that holds the index files, and the name of the shard, for the folder of a GLB."""
    shard = root.resolve().joinpath(*folder)
    return shard.parent.parent if shard.parent.name == "glbs" else shard.parent, shard.name


def _licences(path: Path) -> dict[str, str]:
    index = _read_index(path)
    return {
        uid: str(record["license"])
        for uid, record in index.items()
        if isinstance(record, dict) and record.get("license")
    }


def _categories(path: Path) -> dict[str, str]:
    index = _read_index(path)
    return {
        uid: category
        for category, uids in index.items()
        if isinstance(uids, list)
        for uid in uids
        if isinstance(uid, str)
    }


def _read_index(path: Path) -> dict[str, Any]:
    """A compressed JSON object; empty if the file is not there."""
    if not path.is_file():
        return {}
    try:
        with gzip.open(path) as file:
            data = file.read(_MAX_INDEX_BYTES + 1)
        if len(data) > _MAX_INDEX_BYTES:
            raise ValueError("larger than any index file is")
        index = json.loads(data)
    except (OSError, EOFError, zlib.error, ValueError, RecursionError) as error:
        text = " ".join(str(error).split())[:100]
        raise StoreError(f"{path} is not an Objaverse index file ({text}): download it again") from error
    if not isinstance(index, dict):
        raise StoreError(f"{path} is not an Objaverse index file (no JSON object): download it again")
    return index
