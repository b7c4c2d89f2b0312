"""Toys4K: ``<category>/<category>_<NNN>/mesh.obj``, at any depth.

The public tar has point clouds and renders only. Meshes come by a form, and its zip named obj has been seen to
hold Blender projects.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from waveformer.datagen.catalog_items import CatalogItem, FoundFile, walk_files
from waveformer.simulator.errors import StoreError

_OBJECT = re.compile(r"(.+)_\d{3}$")
_LICENCE = "Creative Commons, per object; the authors ask not to redistribute"
_ONLY_BLEND = "only a Blender project (.blend), no mesh.obj: export it as OBJ in Blender"


def read_toys4k(root: Path) -> Iterator[CatalogItem]:
    """One object for each folder with a mesh.obj, and unusable ones for those with a .blend only; y up, no unit.

    Raises:
        StoreError: there is no mesh.obj at all.
    """
    blend_only: list[CatalogItem] = []
    found_any = found_clouds = False
    for folder, files in groupby(walk_files(root), lambda found: found.parts[:-1]):
        by_suffix: dict[str, FoundFile] = {}
        for found in files:
            found_clouds |= found.name == "pc10K.npz"
            if found.name.lower() == "mesh.obj" or found.suffix == "blend":
                by_suffix[found.suffix] = found
        name = folder[-1] if folder else root.resolve().name
        if "obj" in by_suffix:
            found_any = True
            yield from blend_only
            blend_only.clear()
            yield _item(name, folder, by_suffix["obj"].path, by_suffix["obj"].reason)
        elif "blend" in by_suffix:
            blend_only.append(_item(name, folder, by_suffix["blend"].path, _ONLY_BLEND))
    if found_any:
        yield from blend_only
        return
    hint = "give the folder of the unpacked toys4k_obj_files.zip"
    if blend_only:
        hint = (
            f"it holds {len(blend_only)} Blender projects (.blend) instead, as some copies of "
            "toys4k_obj_files.zip do: export them as <object>/mesh.obj in Blender, or ask for the OBJ files"
        )
    elif found_clouds:
        hint = "it holds the public release, point clouds without meshes: ask the authors for the OBJ files"
    raise StoreError(f"{root} holds no Toys4K mesh (mesh.obj): {hint}")


def _item(name: str, folder: tuple[str, ...], path: str, reason: str) -> CatalogItem:
    numbered = _OBJECT.fullmatch(name)
    category = numbered[1] if numbered else folder[-2] if len(folder) > 1 else ""
    return CatalogItem("toys4k", name, path, category=category, licence=_LICENCE, up_axis="y", reason=reason)
