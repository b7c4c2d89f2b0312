"""The meshes and the box a scan was made of, found again and put where they were."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waveformer.simulator.errors import StoreError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
    import numpy as np

    from waveformer.cli.scan_scene import in_radar_frame
    from waveformer.simulator.mesh import load_mesh

    records = metadata.get("meshes", [])
    if moved_to is None and "scene" in metadata:
        return _of_scene_file(metadata["scene"])
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
        meshes.append(in_radar_frame(mesh, np.asarray(record["pose"])))
    return meshes, remarks


def recorded_box(metadata: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """Outer corners (2, 3) of the box that the metadata of a scan name, or None."""
    import numpy as np

    box = metadata.get("surroundings", {}).get("box")
    return None if box is None else np.array([box["min_m"], box["max_m"]])


def _of_scene_file(record: Mapping[str, Any]) -> tuple[list[SurfaceMesh], list[str]]:
    """The objects of a Mitsuba scene file in the radar frame, or a remark why they are not drawn."""
    from waveformer.cli.scan_scene import geometry_sha256, placed_meshes
    from waveformer.simulator.errors import WaveformerError
    from waveformer.simulator.scene_file import load_scene

    path = record["path"]
    try:
        meshes = placed_meshes(load_scene(path).targets)
    except WaveformerError as error:
        return [], [f"the objects are not drawn: {error}"]
    if geometry_sha256(meshes) != record["geometry_sha256"]:
        return [], [f"scene {path} has changed since the scan and is not drawn"]
    return meshes, []
