"""A catalogue: which objects of a mesh collection can be used, what they are, and which are kept for evaluation."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from waveformer.datagen.catalog_items import OUTSIDE, UpAxis, is_inside
from waveformer.datagen.catalog_mesh import file_sha256, load_placed
from waveformer.simulator.errors import MeshError, StoreError
from waveformer.simulator.mesh import SurfaceMesh

Split = Literal["train", "evaluation"]
SPLITS: tuple[Split, ...] = ("train", "evaluation")
_TRAIN_SHARE = 0.8


@dataclass(frozen=True)
class CatalogEntry:
    """One object of a collection.

    Attributes:
        object_id: unique in its catalogue, "<source>/<name>".
        source: the collection.
        category: "" where unknown.
        path: of the mesh file, relative to the catalogue's root, with "/".
        sha256: of the file's bytes; "" if unusable before it was taken.
        geometry_sha256: of the shape (`geometry_sha256`), equal for copies; "" if unusable.
        faces: after cleaning.
        watertight: every body is closed and wound consistently.
        unit_m: metres per unit of the file; None where unknown.
        up_axis: of the file.
        longest_side_m: of the bounding box; NaN where the unit is unknown.
        licence: "" where unknown.
        split: "train" or "evaluation".
        problems: what was repaired or is odd, one readable line each.
        reason: why the object cannot be used; "" if it can.
    """

    object_id: str
    source: str
    category: str
    path: str
    sha256: str
    geometry_sha256: str
    faces: int
    watertight: bool
    unit_m: float | None
    up_axis: UpAxis
    longest_side_m: float
    licence: str
    split: Split
    problems: tuple[str, ...] = ()
    reason: str = ""

    def __post_init__(self) -> None:
        if not self.object_id or not self.object_id.isprintable() or "\n" in self.reason:
            raise StoreError(f"object_id {self.object_id!r} cannot be shown: rename the object")
        if self.split not in SPLITS or self.up_axis not in ("x", "y", "z"):
            raise StoreError(f"{self.object_id}: no such split or up axis: {self.split}, {self.up_axis}")
        if self.unit_m is not None and not (math.isfinite(self.unit_m) and self.unit_m > 0):
            raise StoreError(
                f"{self.object_id}: unit_m must be a positive number of metres, got {self.unit_m}"
            )
        object.__setattr__(self, "problems", tuple(self.problems))


@dataclass(frozen=True)
class Catalog:
    """Objects below one folder.

    Attributes:
        root: the folder.
        entries: all objects, unusable ones with their reason.
    """

    root: Path
    entries: tuple[CatalogEntry, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "root", Path(self.root))
        object.__setattr__(self, "entries", tuple(self.entries))
        seen: set[str] = set()
        for entry in self.entries:
            if entry.object_id in seen:
                raise StoreError(f"two objects of the catalogue are called {entry.object_id}: rename one")
            seen.add(entry.object_id)

    def write(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write a Parquet file (`catalog_file`), complete or not at all.

        Raises:
            StoreError: it exists and `overwrite` is not set, or cannot be written.
        """
        from waveformer.datagen.catalog_file import write_catalog

        write_catalog(self, path, overwrite=overwrite)

    @staticmethod
    def read(path: str | os.PathLike[str], *, root: str | os.PathLike[str] | None = None) -> Catalog:
        """Read what `write` wrote.

        Args:
            path: of the file.
            root: the folder of the meshes, if they have moved.

        Raises:
            StoreError: no catalogue, a damaged one, or one of another version.
        """
        from waveformer.datagen.catalog_file import read_catalog

        return read_catalog(path, root)

    def select(
        self,
        *,
        sources: Collection[str] | None = None,
        splits: Collection[str] | None = None,
        categories: Collection[str] | None = None,
        limit: int | None = None,
    ) -> Catalog:
        """The usable objects that are wanted, in the catalogue's order.

        Args:
            sources: None takes all.
            splits: None takes both.
            categories: None takes all.
            limit: at most so many. They are chosen by a hash of their shape: a fair sample of all categories, which
                a larger limit only adds to.

        Raises:
            StoreError: a name that no usable object has.
        """
        kept = [entry for entry in self.entries if not entry.reason]
        for what, wanted in (("source", sources), ("split", splits), ("category", categories)):
            if wanted is None:
                continue
            known = {getattr(entry, what) for entry in kept} | (set(SPLITS) if what == "split" else set())
            if unknown := sorted(set(wanted) - known):
                raise StoreError(
                    f"the catalogue has no usable object of {what} {unknown[0]!r}; it has "
                    f"{', '.join(sorted(known)[:20]) or 'none at all'}"
                )
            kept = [entry for entry in kept if getattr(entry, what) in wanted]
        if limit is not None and limit < len(kept):
            if limit < 1:
                raise StoreError(f"limit must be at least 1, got {limit}")
            rank = {entry.object_id: _hash("waveformer.limit", entry) for entry in kept}
            chosen = set(sorted(rank, key=lambda name: (rank[name], name))[:limit])
            kept = [entry for entry in kept if entry.object_id in chosen]
        return Catalog(self.root, tuple(kept))


def load_entry(entry: CatalogEntry, root: str | os.PathLike[str]) -> SurfaceMesh:
    """The mesh of an object: metres (unit unknown: longest side 1), z up, bounding box centred at 0.

    Raises:
        MeshError: the object is not usable, its file is not what was catalogued, or as `load_placed`.
    """
    if entry.reason:
        raise MeshError("mesh.unusable", f"{entry.object_id}: {entry.reason}")
    path = Path(root) / entry.path
    if not path.exists():
        raise MeshError("mesh.missing", f"{entry.object_id}: {path} is gone: scan the folder again")
    if not is_inside(os.path.realpath(root), path):
        raise MeshError("mesh.unreadable", f"{entry.object_id}: {OUTSIDE}")
    if file_sha256(path) != entry.sha256:
        raise MeshError("mesh.changed", f"{entry.object_id}: its file has changed: scan the folder again")
    return dataclasses.replace(load_placed(path, entry.unit_m, entry.up_axis), name=entry.object_id)


def split_of(geometry_sha256: str) -> Split:
    """Train for four shapes of five, whatever else is in the catalogue; copies of a shape always go together."""
    return "train" if _share("waveformer.split", geometry_sha256) < _TRAIN_SHARE else "evaluation"


def mark_copies(
    entries: Iterable[CatalogEntry], held_out: Iterable[Catalog] = ()
) -> tuple[CatalogEntry, ...]:
    """The entries with a reason for each that has the shape of an earlier one or of one in `held_out`."""
    first = {
        entry.geometry_sha256: f"kept out: the same shape as {entry.object_id} of a held-out catalogue"
        for catalog in held_out
        for entry in catalog.entries
        if entry.geometry_sha256
    }
    marked = []
    for entry in entries:
        if entry.reason or not entry.geometry_sha256:
            marked.append(entry)
            continue
        reason = first.setdefault(entry.geometry_sha256, "")
        marked.append(dataclasses.replace(entry, reason=reason) if reason else entry)
        if not reason:
            first[entry.geometry_sha256] = f"duplicate of {entry.object_id}"
    return tuple(marked)


def _hash(purpose: str, entry: CatalogEntry) -> float:
    return _share(purpose, entry.geometry_sha256)


def _share(purpose: str, text: str) -> float:
    """A number in [0, 1) drawn by hashing."""
    digest = hashlib.sha256(f"{purpose} {text}".encode()).digest()
    return int.from_bytes(digest[:7], "big") / 2.0**56
