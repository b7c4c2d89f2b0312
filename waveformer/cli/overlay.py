"""The meshes a scan was made of, found again and put where they were."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waveformer.simulator.errors import StoreError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from waveformer.simulator.mesh import SurfaceMesh


def recorded_meshes(
    metadata: Mapping[str, Any], moved_to: Path | None = None
) -> tuple[list[SurfaceMesh], list[str]]:
    """Load the meshes that the metadata of a scan name.

    Args:
        metadata: of a Measurement.
        moved_to: where the one mesh of the scan lies now, if not where it was.

    Returns:
        Meshes in the radar frame, and one remark for each that is gone or has changed.

    Raises:
        StoreError: `moved_to` is given, but the scan does not have exactly one mesh.
        MeshError: `moved_to` cannot be used.
    """
    from waveformer.simulator.mesh import load_mesh

    records = metadata.get("meshes", [])
    if moved_to is not None:
        if len(records) != 1:
            raise StoreError(f"--mesh stands for the one mesh of a scan, but this one records {len(records)}")
        records = [{**records[0], "path": str(moved_to), "sha256": None}]
    meshes, remarks = [], []
    for record in records:
        path = Path(record["path"])
        if record["sha256"] is not None:
            if not path.is_file():
                remarks.append(
                    f"mesh {path} is no longer there and not drawn; --mesh FILE gives its new place"
                )
                continue
            if hashlib.sha256(path.read_bytes()).hexdigest() != record["sha256"]:
                remarks.append(f"mesh {path} has changed since the scan and is not drawn")
                continue
        mesh = load_mesh(path, fix_winding=record["fix_winding"], unit_m=record["unit_m"])
        meshes.append(in_radar_frame(mesh, record["pose"]))
    return meshes, remarks


def in_radar_frame(mesh: SurfaceMesh, pose: ArrayLike) -> SurfaceMesh:
    """The mesh moved by a rigid pose (4, 4)."""
    import numpy as np

    matrix = np.asarray(pose, float)
    return dataclasses.replace(mesh, vertices_m=mesh.vertices_m @ matrix[:3, :3].T + matrix[:3, 3])
