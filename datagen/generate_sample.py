"""One sample of a generated dataset, from its object's mesh to all its arrays.

mesh       from the catalogue's files                              `catalog`
pose       size and place below the aperture                       `generate_draws`
truth      points of the complete surface                          `surface_samples`
partials   what a specular radar may see of it (Eq. 2-3)           `partials`
signal     H of the object, its occluder and the front end         `simulator`
"""

from __future__ import annotations

import dataclasses
import json
import math
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.catalog import CatalogEntry, load_entry
from waveformer.datagen.dataset_layout import ArrayInfo
from waveformer.datagen.dataset_store import read_layout
from waveformer.datagen.farthest_points import farthest_order
from waveformer.datagen.generate_draws import SampleSeed, draw_placement
from waveformer.datagen.generate_settings import GenerateSettings
from waveformer.datagen.generate_signal import make_signal
from waveformer.datagen.partial_cloud import fixed_size
from waveformer.datagen.partials import draw_partial, view_of
from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.radar import Aperture

MAKER = f"{__name__}:make_sample"
OBJECTS_FILE = "objects.jsonl"
Arrays = dict[str, NDArray[Any]]


class ObjectTable(NamedTuple):
    """The objects of a dataset: sample k shows object k // views.

    Attributes:
        root: folder of the meshes.
        entries: the objects.
    """

    root: Path
    entries: tuple[CatalogEntry, ...]


class _Plan(NamedTuple):
    settings: GenerateSettings
    objects: ObjectTable
    aperture: Aperture


def arrays_of(settings: GenerateSettings) -> tuple[ArrayInfo, ...]:
    """The arrays of every sample."""
    count, axis = settings.truth_points, "axis"
    found = [
        ArrayInfo("truth_m", (count, 3), "float32", ("truth_point", axis), "m"),
        ArrayInfo("truth_normals", (count, 3), "float32", ("truth_point", axis)),
        ArrayInfo("pose", (4, 4), "float64", ("row", "column")),
    ]
    if variants := settings.partial_variants:
        shape = (variants, settings.partial.num_points, 3)
        found += [
            ArrayInfo("partial_m", shape, "float32", ("variant", "partial_point", axis), "m"),
            ArrayInfo("partial_count", (variants,), "int32", ("variant",)),
        ]
    if settings.signal is not None:
        antennas = settings.aperture.num_x * settings.aperture.num_y
        shape_h = (antennas, settings.signal.chirp.num_samples)
        found.append(ArrayInfo("h", shape_h, "complex64", ("position", "chirp_sample")))
    return tuple(found)


def make_sample(root: str, index: int) -> tuple[Arrays, dict[str, Any]]:
    """Make one sample.

    Args:
        root: of the dataset.
        index: of the sample.

    Returns:
        Arrays by name, and the record: all that is needed to make it again.

    Raises:
        MeshError: the mesh cannot be used.
        RadarError: the signal cannot be simulated.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    settings, objects, aperture = _plan(root)
    number, view = divmod(index, settings.views)
    entry = objects.entries[number]
    seed = SampleSeed(settings.seed, entry.object_id, view)
    mesh = load_entry(entry, objects.root)
    placement = draw_placement(
        mesh.vertices_m, entry.unit_m is not None, settings.placement, seed.generator("placement")
    )
    placed = dataclasses.replace(mesh, vertices_m=placement.points(mesh.vertices_m))
    record: dict[str, Any] = {
        "object_id": entry.object_id,
        "category": entry.category,
        "split": entry.split,
        "licence": entry.licence,
        "mesh_sha256": entry.sha256,
        "view": view,
        "scale": placement.scale,
        "support_z_m": placement.support_z_m,
        "bounds_m": [placed.vertices_m.min(axis=0).tolist(), placed.vertices_m.max(axis=0).tolist()],
        "problems": list(mesh.problems),
    }
    truth_m, normals = _truth(root, number)
    truth_m, normals = placement.points(truth_m), placement.normals(normals)
    arrays: Arrays = {
        "truth_m": truth_m.astype(np.float32),
        "truth_normals": normals.astype(np.float32),
        "pose": placement.pose,
    }
    if settings.partial_variants:  # Eq. 2-3
        partials, record["partials"] = _partials(
            TruthCloud(truth_m, normals), placed, aperture, settings, seed
        )
        arrays.update(partials)
    if settings.signal is not None:
        arrays["h"], record["signal"] = make_signal(placed, aperture, settings.signal, seed)
    return arrays, record


def write_objects(objects: ObjectTable) -> bytes:
    """The table of objects as JSON lines, the first of which names the folder of the meshes."""
    lines = [{"root": str(objects.root.resolve())}, *(dataclasses.asdict(entry) for entry in objects.entries)]
    # NaN for an unknown size is no JSON
    rows = [{key: None if _is_nan(value) else value for key, value in line.items()} for line in lines]
    return ("\n".join(json.dumps(row, allow_nan=False) for row in rows) + "\n").encode()


def read_objects(root: Path) -> ObjectTable:
    """The table of objects of a dataset."""
    first, *lines = (root / OBJECTS_FILE).read_text(encoding="utf-8").splitlines()
    entries = []
    for line in lines:
        values = json.loads(line)
        if values["longest_side_m"] is None:
            values["longest_side_m"] = float("nan")
        entries.append(CatalogEntry(**{**values, "problems": tuple(values["problems"])}))
    return ObjectTable(Path(json.loads(first)["root"]), tuple(entries))


@lru_cache(maxsize=2)
def _plan(root: str) -> _Plan:
    settings = GenerateSettings.model_validate(read_layout(Path(root)).settings)
    planar = settings.aperture
    aperture = Aperture.planar_grid(planar.num_x, planar.num_y, planar.spacing_m)
    return _Plan(settings, read_objects(Path(root)), aperture)


@lru_cache(maxsize=2)  # the views of an object follow each other
def _truth(root: str, number: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points and normals of an object in the catalogue's frame, the same for all its views."""
    settings, objects, _ = _plan(root)
    entry = objects.entries[number]
    rng = generator(settings.seed, f"truth of {entry.object_id}")
    truth = sample_ground_truth(load_entry(entry, objects.root), rng, settings.truth_points)
    order = farthest_order(truth.points_m, settings.truth_points)
    assert truth.normals is not None, "sampled from a mesh"
    return truth.points_m[order], truth.normals[order]


def _partials(
    truth: TruthCloud, mesh: SurfaceMesh, aperture: Aperture, settings: GenerateSettings, seed: SampleSeed
) -> tuple[Arrays, list[dict[str, Any]]]:
    """All variants of one view, and what each has drawn."""
    from waveformer.simulator.scene import build_scene

    ranges = settings.partial
    scene = build_scene([(mesh.vertices_m, mesh.faces)]) if ranges.visibility == "rays" else None
    view = view_of(truth, aperture, scene, two_sided=mesh.two_sided, visibility=ranges.visibility)
    drawn = [
        draw_partial(view, ranges, seed.generator(f"partial {variant}"))
        for variant in range(settings.partial_variants)
    ]
    fixed = [fixed_size(partial.points_m, ranges.num_points) for partial in drawn]
    arrays = {
        "partial_m": np.stack([cloud.points_m for cloud in fixed]),
        "partial_count": np.array([cloud.num_valid for cloud in fixed], dtype=np.int32),
    }
    return arrays, [partial.parameters for partial in drawn]


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)
