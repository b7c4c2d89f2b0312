"""A CSV table of meshes: columns object_id and file, and those of its optional ones that it has.

They are set, category, licence, unit_m, up_axis, real_scale and sha256; others are passed over.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from waveformer.datagen.catalog_items import OUTSIDE, UP_AXES, CatalogItem, printable
from waveformer.simulator.errors import StoreError

TABLE_NAME = "INDEX.csv"
_NEEDED = ("object_id", "file")


def read_table(root: Path) -> Iterator[CatalogItem]:
    """One object for each row of the folder's INDEX.csv, with files relative to it.

    The set of a row is its source, "table" without such a column. Without unit_m the unit is metres where
    real_scale is 1, and unknown otherwise.

    Raises:
        StoreError: there is no table, it has no rows or lacks a column.
    """
    table = root / TABLE_NAME
    if not table.is_file():
        raise StoreError(f"{root} holds no {TABLE_NAME}: write one with the columns {', '.join(_NEEDED)}")
    found_any = False
    try:
        with table.open(newline="", encoding="utf-8-sig") as lines:
            reader = csv.DictReader(lines)
            columns = reader.fieldnames or ()
            if missing := [name for name in _NEEDED if name not in columns]:
                raise StoreError(
                    f"{table} has no column {', '.join(missing)}; it has {', '.join(columns) or 'none'}"
                )
            for row in reader:
                found_any = True
                yield _item({name: value or "" for name, value in row.items() if isinstance(name, str)})
    except (UnicodeDecodeError, csv.Error) as error:
        raise StoreError(f"{table} is not a CSV table in UTF-8: {error}") from None
    if not found_any:
        raise StoreError(f"{table} has no rows")


def _item(row: dict[str, str]) -> CatalogItem:
    file = PurePosixPath(row["file"])
    unit_m = 1.0 if row.get("real_scale") == "1" else None
    up_axis = row.get("up_axis", "").lower() or "z"
    reason = ""
    if not row["object_id"] or not row["file"]:
        reason = "its row of the table names no object_id or no file"
    elif file.is_absolute() or ".." in file.parts:
        reason = OUTSIDE
    if row.get("unit_m"):
        try:
            unit_m = float(row["unit_m"])
        except ValueError:
            unit_m = math.nan
        if not (math.isfinite(unit_m) and unit_m > 0):
            unit_m, reason = None, reason or f"unit_m is {row['unit_m']!r}, not a positive number of metres"
    known_axis = next((axis for axis in UP_AXES if axis == up_axis), None)
    if known_axis is None:
        reason = reason or f"up_axis is {up_axis!r}, not x, y or z"
    return CatalogItem(
        printable(row.get("set", "")) or "table",
        printable(row["object_id"]),
        printable(file.as_posix()),
        category=printable(row.get("category", "")),
        licence=printable(row.get("licence", "")),
        unit_m=unit_m,
        up_axis=known_axis or "z",
        expected_sha256=row.get("sha256", "").lower() or None,
        reason=printable(reason),
    )
