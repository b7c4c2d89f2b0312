"""The content of a store: a Zarr v3 group whose every number is verified when it is read.

Zarr alone reads a deleted chunk as fill value, without an error. So a store records a SHA-256 of each array
and of its attributes, besides the CRC-32C that Zarr keeps of each chunk.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from waveformer.simulator.errors import StoreError
from waveformer.simulator.storage import publish, store_format, unfinished_folder


@dataclass(frozen=True)
class StoredArray:
    """One array of a store.

    Attributes:
        values: the numbers, any shape.
        dimensions: one name per axis; xarray aligns arrays by them.
        chunks: chunk shape, same length.
        unit: SI unit, or None for a ratio.
    """

    values: NDArray[Any]
    dimensions: tuple[str, ...]
    chunks: tuple[int, ...]
    unit: str | None = None


def write_store(
    path: str | os.PathLike[str],
    format_name: str,
    schema_version: int,
    arrays: Mapping[str, StoredArray],
    attributes: Mapping[str, Any],
    *,
    overwrite: bool = False,
) -> None:
    """Publish arrays and JSON attributes as one store.

    Args:
        path: directory of the store.
        format_name: e.g. ``"waveformer.image"``.
        schema_version: version of the format's layout.
        arrays: by name.
        attributes: JSON-serialisable.
        overwrite: replace an existing store of the same format.

    Raises:
        StoreError: see `publish`.
    """
    import zarr

    with publish(path, overwrite=overwrite, format_name=format_name) as folder:
        group = zarr.create_group(folder, zarr_format=3)
        for name, array in arrays.items():
            add_array(group, name, array)
        digests = {name: sha256_of(array.values) for name, array in arrays.items()}
        seal(group, format_name, schema_version, attributes, digests)


def add_array(group: Any, name: str, array: StoredArray) -> None:
    """Write one array into an open Zarr group."""
    created = create_array(
        group, name, array.values.shape, array.values.dtype, array.dimensions, array.chunks, array.unit
    )
    created[...] = array.values


def create_array(
    group: Any,
    name: str,
    shape: tuple[int, ...],
    dtype: DTypeLike,
    dimensions: tuple[str, ...],
    chunks: tuple[int, ...],
    unit: str | None = None,
) -> Any:
    """An array of an open Zarr group, to be filled; what the arguments mean says `StoredArray`."""
    from zarr.codecs import Crc32cCodec

    return group.create_array(
        name,
        shape=shape,
        dtype=np.dtype(dtype),
        chunks=tuple(max(1, min(c, n)) for c, n in zip(chunks, shape, strict=True)),
        # H and images do not compress without loss (measured: 1.2x at best), so only checksums.
        compressors=[Crc32cCodec()],
        fill_value=float("nan"),
        dimension_names=dimensions,
        attributes={} if unit is None else {"units": unit},
        config={"write_empty_chunks": True},
    )


def seal(
    group: Any,
    format_name: str,
    schema_version: int,
    attributes: Mapping[str, Any],
    digests: Mapping[str, str],
) -> None:
    """Make a filled group a store: the last thing written, because without these attributes it is none.

    Args:
        group: open Zarr group with all its arrays.
        format_name, schema_version, attributes: see `write_store`.
        digests: SHA-256 of every array's bytes, little-endian, in C order.
    """
    checked = {"format": format_name, "schema_version": schema_version, **attributes}
    group.attrs.update({**checked, "sha256": {**digests, "attributes": _sha256_json(checked)}})


def read_store(
    path: str | os.PathLike[str], format_name: str, schema_version: int
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read and verify a store written by `write_store`.

    Args:
        path: directory of the store.
        format_name: the format it must have.
        schema_version: the newest version of the format that the caller understands.

    Returns:
        Arrays by name and the attributes.

    Raises:
        StoreError: missing, of another kind, from a newer version, or damaged.
    """
    group, attributes, digests = open_store(path, format_name, schema_version)
    return {name: read_array(path, group, name, digest) for name, digest in digests.items()}, attributes


def open_store(
    path: str | os.PathLike[str], format_name: str, schema_version: int
) -> tuple[Any, dict[str, Any], dict[str, str]]:
    """Open a store and verify its attributes, but not yet its arrays.

    Args:
        path, format_name, schema_version: see `read_store`.

    Returns:
        The Zarr group, the attributes, and the SHA-256 of every array by name.

    Raises:
        StoreError: see `read_store`.
    """
    import zarr

    unfinished = Path(path) if Path(path).name.endswith(".unfinished") else unfinished_folder(path)
    if unfinished.is_dir() and (unfinished == Path(path) or not Path(path).exists()):
        raise StoreError(f"{path} is unfinished: run the same simulation again with --resume (resume=True)")
    if not Path(path).exists():
        raise StoreError(f"{path} does not exist")
    found = store_format(path)
    if found is None:
        raise StoreError(f"{path} is not a waveformer store")
    if found != format_name:
        raise StoreError(f"{path} holds a {found}, not a {format_name}")
    with _damage(path):
        group = zarr.open_group(Path(path), mode="r", zarr_format=3)
        attributes = dict(group.attrs)
        version = int(attributes["schema_version"])
        if version > schema_version:
            raise StoreError(
                f"{path} has schema version {version}; this waveformer reads up to {schema_version}: upgrade"
            )
        digests = attributes.pop("sha256")
        if digests.pop("attributes") != _sha256_json(attributes):
            raise StoreError(f"{path} is damaged: its attributes differ from what was written")
    return group, attributes, digests


def read_array(path: str | os.PathLike[str], group: Any, name: str, digest: str) -> NDArray[Any]:
    """One verified array of an open store; raises StoreError if it is damaged."""
    with _damage(path):
        values = np.asarray(group[name][...])
    if sha256_of(values) != digest:
        raise StoreError(f"{path} is damaged: {name} differs from what was written (chunk missing?)")
    return values


def read_rows(path: str | os.PathLike[str], group: Any, name: str, rows: slice) -> NDArray[Any]:
    """Some rows of an array of an open store, verified by the CRC-32C of their chunks.

    Raises:
        StoreError: a chunk is damaged or missing.
    """
    with _damage(path):
        array = group[name]
        # zarr would read a missing chunk as fill value.
        if array.nchunks_initialized < array.nchunks:
            raise StoreError(f"{path} is damaged: chunks of {name} are missing")
        return np.asarray(array[rows])


@contextmanager
def _damage(path: str | os.PathLike[str]) -> Iterator[None]:
    """A damaged store can fail in any layer of zarr, with any exception."""
    try:
        yield
    except StoreError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise StoreError(f"{path} is damaged: {reason}") from error


def sha256_of(values: NDArray[Any]) -> str:
    """SHA-256 of an array's bytes, little-endian, in C order."""
    contiguous = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return hashlib.sha256(contiguous.reshape(-1).view(np.uint8).data).hexdigest()


def _sha256_json(attributes: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(attributes, sort_keys=True).encode()).hexdigest()
