"""A twin on disk: ROOT/<condition>/<object id>/ with the scan, and its truth beside it.

Each of these folders appears complete or not at all. ROOT/twin.json holds the settings that all have in common.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.twin_settings import TwinSettings
from waveformer.simulator.errors import StoreError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.storage import publish, publish_file

ROOT_FILE = "twin.json"
RECORD_FILE = "truth.json"
MESH_FILE = "truth.ply"
SCAN_FOLDER = "scan.zarr"
_ROOT_FORMAT, _RECORD_FORMAT = "waveformer.twin", "waveformer.twin_scan"
_VERSION = 1


@dataclass(frozen=True, eq=False)
class TwinScan:
    """One scan of a twin, and what is known about its object.

    Attributes:
        path: its folder.
        object_id, condition: which object, and how it was recorded.
        record: truth.json: pose, support_z_m, reflectivity, bounds_m, crop_m, settings, identity, versions.
    """

    path: Path
    object_id: str
    condition: str
    record: Mapping[str, Any]

    @property
    def scan_path(self) -> Path:
        """The saved Measurement."""
        return self.path / SCAN_FOLDER

    @property
    def crop_m(self) -> NDArray[np.float64]:
        """Lower and upper corner of the box to be imaged, shape (2, 3)."""
        return np.asarray(self.record["crop_m"], dtype=np.float64)

    def measurement(self) -> Measurement:
        """The raw scan; raises StoreError if it is missing or damaged."""
        return Measurement.load(self.scan_path)

    def truth_mesh(self) -> SurfaceMesh:
        """The object's surface in the radar frame; raises MeshError if it cannot be read."""
        return load_mesh(self.path / MESH_FILE)


def twin_scans(root: str | Path) -> list[TwinScan]:
    """All finished scans of a twin, sorted by condition and object.

    Raises:
        StoreError: no twin, or one of its records is damaged or from a newer version.
    """
    root = Path(root)
    _read_json(root / ROOT_FILE, _ROOT_FORMAT, "give the folder that waveformer twin wrote")
    paths = root.glob(f"*/*/{RECORD_FILE}")
    return [
        read_scan(path.parent) for path in sorted(paths) if not path.parent.name.startswith(".")
    ]  # those with a dot are being written


def read_scan(folder: Path) -> TwinScan:
    """One finished scan; raises StoreError if its record is missing, damaged or from a newer version."""
    record = _read_json(folder / RECORD_FILE, _RECORD_FORMAT, "make it again")
    return TwinScan(folder, record["object_id"], record["identity"]["condition"]["name"], record)


def begin_root(root: Path, settings: TwinSettings) -> None:
    """Write the settings of a twin, if they are not there."""
    if not (root / ROOT_FILE).exists():
        described = settings.describe()
        _write_json(root / ROOT_FILE, {"format": _ROOT_FORMAT, "version": _VERSION, "settings": described})


def check_root(root: Path, settings: TwinSettings) -> None:
    """Raise StoreError if a folder holds something else than a twin of these settings; it may be missing."""
    if (root / ROOT_FILE).is_file():
        described = json.loads(json.dumps(settings.describe()))
        found = _read_json(root / ROOT_FILE, _ROOT_FORMAT, "choose another folder")["settings"]
        if different := difference(found, described):
            raise StoreError(
                f"{root} holds a twin of other settings ({different}): choose another folder, or repeat them"
            )
    elif root.exists() and not (root.is_dir() and all(path.name.startswith(".") for path in root.iterdir())):
        raise StoreError(f"{root} is not empty and holds no twin: choose another folder")


def is_finished(folder: Path, identity: Mapping[str, Any]) -> bool:
    """Whether a scan is there.

    Args:
        folder: of the scan.
        identity: all that determines it, JSON values.

    Raises:
        StoreError: a scan of another identity is there, or something else.
    """
    if not folder.exists():
        return False
    if different := difference(read_scan(folder).record["identity"], json.loads(json.dumps(identity))):
        raise StoreError(
            f"{folder} was made otherwise ({different}): choose another folder, or remove this one"
        )
    return True


def write_scan(
    folder: Path,
    measurement: Measurement,
    truth: SurfaceMesh,
    record: Mapping[str, Any],
    identity: Mapping[str, Any],
) -> None:
    """Publish one scan with its truth.

    Args:
        folder: of the scan, not there yet.
        measurement: the scan.
        truth: the object in the radar frame.
        record: what else is known, JSON values; object_id is needed.
        identity: all that determines the scan, see `is_finished`.

    Raises:
        StoreError: it cannot be written.
    """
    import trimesh

    with publish(folder) as temporary:
        measurement.save(temporary / SCAN_FOLDER)
        trimesh.Trimesh(truth.vertices_m, truth.faces, process=False).export(temporary / MESH_FILE)
        _write_json(
            temporary / RECORD_FILE,
            {"format": _RECORD_FORMAT, "version": _VERSION, **record, "identity": identity},
        )


def sweep(root: Path) -> None:
    """Remove what a killed run left half-written; nobody else may be writing."""
    for path in root.glob("*/.*.partial"):
        shutil.rmtree(path, ignore_errors=True)


def difference(found: Any, expected: Any, name: str = "") -> str:
    """The first value in which two JSON values differ, as ``name: found, not expected``; empty if they are equal."""
    if isinstance(found, dict) and isinstance(expected, dict):
        for key in {**expected, **found}:
            inner = f"{name}.{key}" if name else str(key)
            if text := difference(found.get(key), expected.get(key), inner):
                return text
        return ""
    return "" if found == expected else f"{name}: {json.dumps(found)}, not {json.dumps(expected)}"


def _read_json(path: Path, format_name: str, remedy: str) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        found, version = values["format"], values["version"]
    except FileNotFoundError:
        raise StoreError(f"{path} is missing: {remedy}") from None
    except OSError as error:
        raise StoreError(f"{path} cannot be read ({error.strerror}): {remedy}") from None
    except (ValueError, KeyError, TypeError):
        raise StoreError(f"{path} is damaged: {remedy}") from None
    if found != format_name:
        raise StoreError(f"{path} is a {found}, not a {format_name}: {remedy}")
    if version > _VERSION:
        raise StoreError(f"{path} has version {version}; this waveformer reads up to {_VERSION}: upgrade")
    return dict(values)


def _write_json(path: Path, values: Mapping[str, Any]) -> None:
    with publish_file(path) as temporary:
        temporary.write_text(json.dumps(values, indent=1, allow_nan=False) + "\n", encoding="utf-8")
