"""Objaverse-XL's Thingiverse part: ``thingiverse/thing-<thing>-file-<file>.stl`` and ``thingiverse.parquet``.

The downloader names everything .stl, whatever the bytes are, and keeps files of a wrong SHA-256. The table tells
what each should be; it has millions of rows and is read in pieces, keeping those that are on the disk.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from waveformer.datagen.catalog_items import CatalogItem, FoundFile, walk_files
from waveformer.simulator.errors import StoreError

_TABLE_NAME = "thingiverse.parquet"
_FILE = re.compile(r"thing-(\d+)-file-(\d+)\.stl", re.IGNORECASE)
_IDENTIFIER = re.compile(r"thing:(\d+)/.*fileId=(\d+)")
_COLUMNS = ("fileIdentifier", "license", "sha256")
_MISNAMED = "its name is not thing-<number>-file-<number>.stl: scan such files with --source folder"
_UNLISTED = f"not in {_TABLE_NAME}, so its licence and SHA-256 are unknown"
_NO_TABLE = f"there is no {_TABLE_NAME}, so its licence and SHA-256 are unknown"


def read_thingiverse(root: Path) -> Iterator[CatalogItem]:
    """One object for each STL; millimetres, z up.

    Raises:
        StoreError: there is no such file, or the table cannot be read.
    """
    files: list[FoundFile] = []
    table: str | None = None
    for found in walk_files(root):
        if found.suffix == "stl":
            files.append(found)
        elif found.name == _TABLE_NAME and not found.reason:
            table = table or found.path
    if not any(_FILE.fullmatch(found.name) for found in files):
        raise StoreError(
            f"{root} holds no file thing-<number>-file-<number>.stl: give the download folder of "
            "Objaverse-XL, or scan other STL files with --source folder"
        )
    wanted = {_key(found) for found in files}
    listed = _read_table(root / table, wanted) if table else {}
    for found in files:
        key = _key(found)
        licence, sha256 = listed.get(key, ("", None)) if key else ("", None)
        note = "" if sha256 else _UNLISTED if table else _NO_TABLE
        yield CatalogItem(
            "thingiverse",
            found.stem if key else found.path,
            found.path,
            licence=licence,
            unit_m=1e-3,
            expected_sha256=sha256,
            notes=(note,) if note else (),
            reason=found.reason or ("" if key else _MISNAMED),
        )


def _key(found: FoundFile) -> tuple[str, str] | None:
    match = _FILE.fullmatch(found.name)
    return (match[1], match[2]) if match else None


def _read_table(
    path: Path, wanted: set[tuple[str, str] | None]
) -> dict[tuple[str, str], tuple[str, str | None]]:
    """Licence and SHA-256 of the wanted (thing, file)."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    listed: dict[tuple[str, str], tuple[str, str | None]] = {}
    try:
        for batch in pq.ParquetFile(path).iter_batches(columns=list(_COLUMNS)):
            if missing := set(_COLUMNS) - set(batch.schema.names):
                raise StoreError(f"{path} has no column {min(missing)}: download it again")
            for identifier, licence, sha256 in zip(
                *(batch.column(name).to_pylist() for name in _COLUMNS), strict=True
            ):
                match = _IDENTIFIER.search(str(identifier))
                if match and (key := (match[1], match[2])) in wanted:
                    listed.setdefault(key, (str(licence or ""), str(sha256).lower() if sha256 else None))
    except (pa.ArrowException, OSError, ValueError) as error:
        text = " ".join(str(error).split())[:100]
        raise StoreError(f"{path} cannot be read ({text}): download it again") from error
    return listed
