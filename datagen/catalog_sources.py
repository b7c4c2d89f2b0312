"""The collections whose layout on the disk is known, by name."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from waveformer.datagen.catalog_folder import read_folder
from waveformer.datagen.catalog_items import CatalogItem, Reader
from waveformer.datagen.catalog_objaverse import read_objaverse
from waveformer.datagen.catalog_omniobject3d import read_omniobject3d
from waveformer.datagen.catalog_table import read_table
from waveformer.datagen.catalog_thingiverse import read_thingiverse
from waveformer.datagen.catalog_toys4k import read_toys4k
from waveformer.datagen.catalog_ycb import read_ycb
from waveformer.simulator.errors import StoreError

READERS: dict[str, Reader] = {
    "omniobject3d": read_omniobject3d,
    "toys4k": read_toys4k,
    "objaverse": read_objaverse,
    "thingiverse": read_thingiverse,
    "ycb": read_ycb,
    "folder": read_folder,
    "table": read_table,
}


def read_source(root: Path, source: str) -> Iterator[CatalogItem]:
    """The objects of a folder, as the reader of that name finds them.

    Raises:
        StoreError: an unknown source, no such folder, or one of another layout.
    """
    if source not in READERS:
        raise StoreError(f"unknown source {source!r}; known: {', '.join(READERS)}")
    if not root.is_dir():
        raise StoreError(f"{root} is not a folder: give the folder the meshes lie in")
    return READERS[source](root)
