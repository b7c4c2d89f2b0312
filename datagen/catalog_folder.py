"""Any folder of mesh files: each file an object, called as its path, its category the folder it lies in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from waveformer.datagen.catalog_items import CatalogItem, FoundFile, walk_files
from waveformer.simulator.errors import StoreError
from waveformer.simulator.mesh_formats import ARCHIVE_FORMATS, MESH_FORMATS

_OTHER_MESHES = (
    *("3ds", "3mf", "blend", "dae", "fbx", "usd", "usda", "usdc", "usdz", "step", "stp", "iges", "igs"),
    *("wrl", "x3d", "xyz", "pcd", "las"),
)


def read_folder(root: Path) -> Iterator[CatalogItem]:
    """One object for each mesh file; z up, unit unknown. Archives and other 3D formats are named, not opened.

    Raises:
        StoreError: there is neither.
    """
    found_any = False
    for found in walk_files(root):
        reason = found.reason or _refusal(found)
        if not reason and found.suffix not in MESH_FORMATS:
            continue
        found_any = True
        category = found.parts[-2] if len(found.parts) > 1 else ""
        yield CatalogItem("folder", found.path, found.path, category=category, reason=reason)
    if not found_any:
        raise StoreError(
            f"{root} holds no mesh file ({', '.join(MESH_FORMATS)}): give the folder of the meshes"
        )


def _refusal(found: FoundFile) -> str:
    if found.suffix in ARCHIVE_FORMATS:
        return "archives are not opened: unpack it"
    if found.suffix in _OTHER_MESHES:
        return f"the format .{found.suffix} is not read: export it as one of {', '.join(MESH_FORMATS)}"
    return ""
