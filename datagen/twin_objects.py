"""Which objects a twin is made of: folders, mesh files, or tables that name them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from waveformer.simulator.errors import StoreError
from waveformer.simulator.mesh_formats import MESH_FORMATS

_TABLE_COLUMNS = ("object_id", "file")


@dataclass(frozen=True)
class TwinObject:
    """One object.

    Attributes:
        object_id: its name, which becomes a folder's.
        path: its mesh, in metres.
    """

    object_id: str
    path: Path

    def __post_init__(self) -> None:
        if not self.object_id or self.object_id.startswith(".") or "/" in self.object_id:
            raise StoreError(
                f"{self.path}: object_id {self.object_id!r} cannot name a folder: rename the object"
            )


def find_objects(
    sources: Sequence[Path], mesh_set: str | None = None, limit: int | None = None
) -> list[TwinObject]:
    """The objects that folders, mesh files and tables name, in this order.

    Args:
        sources: folders (their mesh files, sorted by name), mesh files (called as the file), or CSV tables with the
            columns object_id and file (relative to the table), and set if `mesh_set` is given.
        mesh_set: take only the rows of a table that have this set.
        limit: take the first ones only.

    Raises:
        StoreError: a source is missing or names no object, a table lacks a column or the set, or two objects have
            one name.
    """
    found: dict[str, TwinObject] = {}
    for source in sources:
        for item in _objects_of(Path(source), mesh_set):
            if item.object_id in found:
                raise StoreError(
                    f"two objects are called {item.object_id}: {found[item.object_id].path} and {item.path}; "
                    "rename one, or choose a set of the table (--set)"
                )
            found[item.object_id] = item
    return list(found.values())[:limit]


def _objects_of(source: Path, mesh_set: str | None) -> list[TwinObject]:
    if source.is_dir():
        meshes = sorted(path for path in source.iterdir() if path.suffix.lower()[1:] in MESH_FORMATS)
        if not meshes:
            raise StoreError(
                f"{source} holds no mesh file ({', '.join(MESH_FORMATS)}): give the folder that holds them, or a table"
            )
        return [TwinObject(path.stem, path) for path in meshes]
    if not source.is_file():
        raise StoreError(f"{source} does not exist: give a folder, a mesh file, or a table (CSV) of meshes")
    return _rows(source, mesh_set) if source.suffix.lower() == ".csv" else [TwinObject(source.stem, source)]


def _rows(table: Path, mesh_set: str | None) -> list[TwinObject]:
    try:
        with table.open(newline="", encoding="utf-8") as lines:
            reader = csv.DictReader(lines)
            columns, rows = reader.fieldnames or (), list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        raise StoreError(f"{table} is not a CSV table in UTF-8: {error}") from None
    needed = _TABLE_COLUMNS if mesh_set is None else (*_TABLE_COLUMNS, "set")
    if missing := [name for name in needed if name not in columns]:
        raise StoreError(f"{table} has no column {', '.join(missing)}; it has {', '.join(columns) or 'none'}")
    if mesh_set is not None:
        known = dict.fromkeys(row["set"] for row in rows)
        if mesh_set not in known:
            raise StoreError(f"{table} has no set {mesh_set!r}; known: {', '.join(known)}")
        rows = [row for row in rows if row["set"] == mesh_set]
    for number, row in enumerate(rows, start=1):
        if any(row[name] is None for name in _TABLE_COLUMNS):
            raise StoreError(f"{table}: row {number} ends before {' and '.join(_TABLE_COLUMNS)}")
    if not rows:
        raise StoreError(f"{table} has no rows")
    return [TwinObject(row["object_id"], table.parent / row["file"]) for row in rows]
