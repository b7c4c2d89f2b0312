"""A catalogue as a Parquet file: a column for each field of `CatalogEntry`, version and root in the metadata."""

from __future__ import annotations

import dataclasses
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waveformer.datagen.catalog import Catalog, CatalogEntry
from waveformer.simulator.errors import StoreError
from waveformer.simulator.storage import publish_file

if TYPE_CHECKING:
    import pyarrow as pa

_FORMAT, _VERSION = "waveformer.catalog", "1"


def write_catalog(catalog: Catalog, path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """See `Catalog.write`. A root beside or below the file is written relative to it, so that both may move."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    metadata = {
        "waveformer.format": _FORMAT,
        "waveformer.version": _VERSION,
        "waveformer.root": _portable_root(catalog.root, Path(path)),
    }
    columns = {
        field.name: [_to_column(getattr(entry, field.name)) for entry in catalog.entries]
        for field in dataclasses.fields(CatalogEntry)
    }
    table = pa.table(columns, schema=_schema().with_metadata(metadata))
    with publish_file(path, overwrite=overwrite) as temporary:
        pq.write_table(table, temporary)


def read_catalog(path: str | os.PathLike[str], root: str | os.PathLike[str] | None) -> Catalog:
    """See `Catalog.read`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not Path(path).is_file():
        raise StoreError(f"{path} does not exist: make it with waveformer catalog scan")
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError, ValueError) as error:
        text = " ".join(str(error).split())[:100]
        raise StoreError(f"{path} is no catalogue, or damaged ({text}): make it again") from error
    metadata = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    if metadata.get("waveformer.format") != _FORMAT:
        raise StoreError(f"{path} is a Parquet file but no catalogue: make one with waveformer catalog scan")
    if (version := metadata.get("waveformer.version")) != _VERSION:
        raise StoreError(f"{path} is a catalogue of version {version}, this program reads {_VERSION}")
    if not table.schema.remove_metadata().equals(_schema()):
        raise StoreError(f"{path} lacks columns of a catalogue or has other ones: make it again")
    entries = (
        CatalogEntry(**{name: _from_column(name, value) for name, value in row.items()})
        for row in table.to_pylist()
    )
    folder = Path(root) if root is not None else Path(path).resolve().parent / metadata["waveformer.root"]
    return Catalog(folder, tuple(entries))


def _schema() -> pa.Schema:
    import pyarrow as pa

    types: dict[str, Any] = {
        "faces": pa.int64(),
        "watertight": pa.bool_(),
        "unit_m": pa.float64(),
        "longest_side_m": pa.float64(),
        "problems": pa.list_(pa.string()),
    }
    names = [field.name for field in dataclasses.fields(CatalogEntry)]
    return pa.schema([(name, types.get(name, pa.string())) for name in names])


def _portable_root(root: Path, path: Path) -> str:
    real_root, folder = root.resolve(), path.resolve().parent
    if folder in (real_root, *real_root.parents) or real_root in folder.parents:
        return os.path.relpath(real_root, folder)
    return str(real_root)


def _to_column(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _from_column(name: str, value: Any) -> Any:
    if name == "longest_side_m" and value is None:
        return math.nan
    return tuple(value or ()) if name == "problems" else value
