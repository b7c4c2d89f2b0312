"""OmniObject3D: ``raw_scans/<category>/<object>/Scan/Scan.obj``, at any depth.

Its archives are unpacked into a new folder each, so that categories may appear twice along the path; only the
last folders count. Units are documented nowhere, and coordinates of an apple exceed 10: they are not metres.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from waveformer.datagen.catalog_items import CatalogItem, walk_files
from waveformer.simulator.errors import StoreError

_OBJECT = re.compile(r"(.+)_\d+$")


def read_omniobject3d(root: Path) -> Iterator[CatalogItem]:
    """One object for each ``Scan/Scan.obj``; y up, unit unknown.

    Raises:
        StoreError: there is none.
    """
    found_any = False
    others = {"archives": False, "clouds": False}
    for found in walk_files(root):
        parts = found.parts
        if [part.lower() for part in parts[-2:]] != ["scan", "scan.obj"]:
            others["archives"] |= found.suffix in ("gz", "tar", "zip")
            others["clouds"] |= found.name.startswith("pcd_") or found.suffix == "hdf5"
            continue
        found_any = True
        object_id = parts[-3] if len(parts) > 2 else root.resolve().name
        numbered = _OBJECT.fullmatch(object_id)
        yield CatalogItem(
            "omniobject3d",
            object_id,
            found.path,
            category=numbered[1] if numbered else parts[-4] if len(parts) > 3 else "",
            licence="CC-BY-4.0",
            up_axis="y",
            reason=found.reason,
        )
    if not found_any:
        hint = "give the folder above raw_scans"
        if others["archives"]:
            hint = "it holds archives: unpack those of raw_scans first"
        elif others["clouds"]:
            hint = "it holds point clouds, which have no surface: get raw_scans as well"
        raise StoreError(f"{root} holds no OmniObject3D scan (Scan/Scan.obj): {hint}")
