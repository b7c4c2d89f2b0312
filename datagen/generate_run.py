"""Preparing a generated dataset: which objects, which arrays, how many samples a shard."""

from __future__ import annotations

import hashlib
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

from waveformer import __version__
from waveformer.datagen.catalog import Catalog
from waveformer.datagen.dataset_layout import DatasetLayout
from waveformer.datagen.dataset_store import create_dataset
from waveformer.datagen.generate_sample import MAKER, OBJECTS_FILE, ObjectTable, arrays_of, write_objects
from waveformer.datagen.generate_settings import GenerateSettings
from waveformer.simulator.errors import StoreError

_PACKAGES = ("numpy", "scipy", "mitsuba", "drjit", "trimesh", "zarr")
_SHARD_BYTES = 32 * 2**20
_MOST_SHARD_SAMPLES = 32
_GIB = 2**30


def prepare_dataset(root: Path, catalog: Catalog, settings: GenerateSettings) -> DatasetLayout:
    """Create a dataset in which nothing is made yet, or accept the one that is there.

    Args:
        root: of the dataset.
        catalog: of its objects; unusable ones are left out.
        settings: of its samples.

    Returns:
        Its layout; `factory_run.run_factory` makes the samples.

    Raises:
        StoreError: the catalogue has no usable object, something else is there, or it cannot be written.
    """
    entries = tuple(entry for entry in catalog.entries if not entry.reason)
    if not entries:
        raise StoreError("the catalogue has no usable object: see waveformer catalog show")
    table = write_objects(ObjectTable(catalog.root, entries))
    arrays = arrays_of(settings)
    per_sample = sum(info.sample_bytes for info in arrays)
    shard = settings.shard_samples or max(1, min(_MOST_SHARD_SAMPLES, _SHARD_BYTES // per_sample))
    layout = DatasetLayout(
        "generate",
        MAKER,
        settings.model_dump(mode="json"),
        arrays,
        len(entries) * settings.views,
        shard,
        {OBJECTS_FILE: hashlib.sha256(table).hexdigest()},
        settings.time_limit_s,
        round(settings.memory_limit_gib * _GIB),
    )
    create_dataset(root, layout, {OBJECTS_FILE: table}, provenance())
    return layout


def provenance() -> dict[str, Any]:
    """Versions that a dataset is made with."""
    return {
        "waveformer": __version__,
        "git": _git_hash(),
        "python": platform.python_version(),
        "packages": {name: version(name) for name in _PACKAGES},
    }


def _git_hash() -> str | None:
    """Commit of the source this runs from; None for an installed package."""
    folder = Path(__file__).resolve().parent
    try:
        found = subprocess.run(
            ["git", "-C", str(folder), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return found.stdout.strip() if found.returncode == 0 else None
