"""Makers for the tests of readers, loaders and exports: the arrays of real datasets, small."""

from __future__ import annotations

import numpy as np

from waveformer.datagen.dataset_layout import ArrayInfo, DatasetLayout
from waveformer.datagen.dataset_store import create_dataset
from waveformer.datagen.factory_run import run_factory
from waveformer.simulator.errors import MeshError

NUM_X, NUM_Y, NUM_CHIRP_SAMPLES = 4, 3, 8
QUARANTINED = (3, 8)
SETTINGS = {
    "aperture": {"num_x": NUM_X, "num_y": NUM_Y, "spacing_m": 0.004},
    "signal": {"chirp": {"start_hz": 77.5001e9, "bandwidth_hz": 3.0009e9, "num_samples": NUM_CHIRP_SAMPLES}},
}
ARRAYS = (
    ArrayInfo("truth_m", (30, 3), "float32", ("truth_point", "axis"), "m"),
    ArrayInfo("truth_normals", (30, 3), "float32", ("truth_point", "axis")),
    ArrayInfo("pose", (4, 4), "float64", ("row", "column")),
    ArrayInfo("partial_m", (2, 10, 3), "float32", ("variant", "partial_point", "axis"), "m"),
    ArrayInfo("partial_count", (2,), "int32", ("variant",)),
    ArrayInfo("h", (NUM_X * NUM_Y, NUM_CHIRP_SAMPLES), "complex64", ("position", "chirp_sample")),
)


def create(root, num_samples, arrays=ARRAYS, maker="reading_makers:sample"):
    """A dataset in which nothing is made."""
    layout = DatasetLayout("generate", maker, SETTINGS, arrays, num_samples, shard_samples=4)
    create_dataset(root, layout, {}, {"waveformer": "test"})
    return layout


def make(root, num_samples):
    """A whole dataset; samples 3 and 8 are quarantined."""
    create(root, num_samples)
    run_factory(root)
    return root


def arrays_of(index):
    """What sample `index` consists of."""
    rng = np.random.default_rng([3, index])
    found = {}
    for info in ARRAYS:
        values = rng.normal(size=(*info.shape, 2))
        real = values[..., 0] + 1j * values[..., 1] if info.dtype == "complex64" else 5 * values[..., 0]
        found[info.name] = real.astype(info.dtype)
    found["h"] *= np.float32(1e-4)
    found["partial_m"][1, 7:] = np.nan
    found["partial_count"] = np.array([10, 7], dtype=np.int32)
    return found


def sample(root, index):
    """Every third object is for evaluation; sample 3 and 8 have bad meshes."""
    if index in QUARANTINED:
        raise MeshError("mesh.empty", f"object {index // 2}: no faces; export it again")
    record = {
        "object_id": f"test/{index // 2}",
        "category": ("cup", "spoon")[index // 2 % 2],
        "partials": [{"kept_points": 500}, {"kept_points": 10 * index}],
        "split": "evaluation" if index // 2 % 3 == 2 else "train",
        "view": index % 2,
    }
    return arrays_of(index), record
