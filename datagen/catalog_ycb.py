"""YCB: ``<NNN_name>/google_16k/nontextured.ply`` and its siblings, at any depth.

Google's scans come first, the Berkeley meshes (poisson, tsdf) stand in where there is none, and meshes that lie
directly in an object's folder are taken too. Metres, z up.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from waveformer.datagen.catalog_items import CatalogItem, FoundFile, walk_files
from waveformer.simulator.errors import StoreError
from waveformer.simulator.mesh_formats import MESH_FORMATS

# Lists spell some names 027-skillet, the archives 027_skillet.
_OBJECT = re.compile(r"(\d{3}(?:-[a-z])?)[_-]([a-z0-9_-]+)", re.IGNORECASE)
_FOLDERS = ("google_16k", "google_64k", "google_512k", "poisson", "tsdf")
_NAMES = ("nontextured.ply", "textured.obj", "nontextured.stl", "textured.ply")
_KNOWN_FAULTS = {
    "022": "the scan misses its transparent middle",
    "028": "the scan has the rim of the lid only",
    "030": "a noisy, thick scan of a shiny object",
    "031": "a noisy, thick scan of a shiny object",
    "032": "a noisy, thick scan of a shiny object",
    "038": "a noisy scan of a shiny object",
    "063-a": "a heap of several pieces; 063-b is one piece",
    "070-a": "a heap of several pieces; 070-b is one piece",
}
_NO_MESH = "no mesh in its folder (google_16k, poisson, tsdf): Google has not scanned every YCB object"


def read_ycb(root: Path) -> Iterator[CatalogItem]:
    """One object for each folder NNN_name, with the best mesh in it.

    Raises:
        StoreError: there is no such folder.
    """
    found_any = False
    for folder, files in groupby(walk_files(root), _object_folder):
        if folder:
            found_any = True
            yield _best(folder, list(files))
    if not found_any:
        raise StoreError(
            f"{root} holds no YCB object (NNN_name/google_16k/...): give the folder that holds "
            "003_cracker_box and so on, archives unpacked"
        )


def _object_folder(found: FoundFile) -> str:
    """The path of the folder NNN_name a file lies in, "" if in none."""
    folders = found.parts if found.reason else found.parts[:-1]
    for depth in range(len(folders), 0, -1):
        if _OBJECT.fullmatch(folders[depth - 1]):
            return "/".join(folders[:depth])
    return ""


def _best(folder: str, files: list[FoundFile]) -> CatalogItem:
    match = _OBJECT.fullmatch(folder.rsplit("/", 1)[-1])
    assert match is not None
    number, name = match[1].lower(), match[2].lower()
    notes = [_KNOWN_FAULTS[number]] if number in _KNOWN_FAULTS else []
    ranked = sorted((rank, found.path, found) for found in files if (rank := _rank(folder, found)))
    path, reason = folder, _NO_MESH
    if ranked:
        path, reason = ranked[0][1], ranked[0][2].reason
        if ranked[0][0][0] >= _FOLDERS.index("poisson"):
            notes.append("no Google scan here: another mesh stands in")
    elif files and files[0].reason:
        reason = files[0].reason
    return CatalogItem(
        "ycb",
        f"{number}_{name}",
        path,
        category=name,
        licence="CC-BY-4.0",
        unit_m=1.0,
        notes=tuple(notes),
        reason=reason,
    )


def _rank(folder: str, found: FoundFile) -> tuple[int, int] | None:
    """Smaller is better; None for what is not a mesh of the object."""
    inside = found.path[len(folder) + 1 :].split("/")
    if found.suffix not in MESH_FORMATS or not inside[0]:
        return None
    name = inside[-1].lower()
    if len(inside) == 1:
        return len(_FOLDERS), 0
    if inside[-2].lower() not in _FOLDERS or name not in _NAMES:
        return None
    return _FOLDERS.index(inside[-2].lower()), _NAMES.index(name)
