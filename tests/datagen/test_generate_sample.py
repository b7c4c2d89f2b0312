"""Samples of real meshes: their arrays agree with each other, and with nothing but seed, object and view."""

import numpy as np
import pytest

from waveformer.datagen.catalog_scan import scan_catalog
from waveformer.datagen.dataset_store import read_layout
from waveformer.datagen.generate_run import prepare_dataset
from waveformer.datagen.generate_sample import make_sample, read_objects
from waveformer.datagen.generate_settings import (
    ApertureSettings,
    GenerateSettings,
    OccluderSettings,
    SignalSettings,
)
from waveformer.datagen.procedural_meshes import KINDS, write_procedural_meshes
from waveformer.simulator.errors import MeshError, StoreError

SETTINGS = GenerateSettings(
    views=2,
    truth_points=2048,
    partial_variants=2,
    aperture=ApertureSettings(num_x=16, num_y=20),
    signal=SignalSettings(),
)


@pytest.fixture(scope="module")
def catalog(tmp_path_factory, mitsuba_variant):
    folder = tmp_path_factory.mktemp("meshes")
    write_procedural_meshes(folder, 6)
    return scan_catalog(folder, "folder", unit_m=1.0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory, catalog):
    root = tmp_path_factory.mktemp("generated") / "store"
    prepare_dataset(root, catalog, SETTINGS)
    return root


def test_the_arrays_of_a_sample(dataset):
    arrays, record = make_sample(str(dataset), 3)
    layout = read_layout(dataset)
    assert {info.name: info.shape for info in layout.arrays} == {name: a.shape for name, a in arrays.items()}
    assert {info.name: info.dtype for info in layout.arrays} == {
        name: str(a.dtype) for name, a in arrays.items()
    }
    low, high = np.asarray(record["bounds_m"])
    assert (arrays["truth_m"] >= low - 1e-5).all() and (arrays["truth_m"] <= high + 1e-5).all()
    np.testing.assert_allclose(np.linalg.norm(arrays["truth_normals"], axis=1), 1.0, atol=1e-5)
    for variant, count in enumerate(arrays["partial_count"]):
        assert np.isfinite(arrays["partial_m"][variant, :count]).all()
        assert np.isnan(arrays["partial_m"][variant, count:]).all()
    assert np.isfinite(arrays["h"]).all() and np.abs(arrays["h"]).max() > 0
    assert record["view"] == 1 and len(record["partials"]) == 2 and record["signal"]["mode"] == "draft"


def test_the_first_truth_points_cover_the_surface(dataset):
    from scipy.spatial import KDTree

    truth_m = make_sample(str(dataset), 0)[0]["truth_m"].astype(float)
    gap_m = KDTree(truth_m[:128]).query(truth_m)[0].max()
    random_m = KDTree(np.random.default_rng(0).permutation(truth_m)[:128]).query(truth_m)[0].max()
    assert gap_m < 0.8 * random_m


def test_views_differ_and_share_their_truth(dataset):
    (first, one), (second, two) = make_sample(str(dataset), 0), make_sample(str(dataset), 1)
    assert one["object_id"] == two["object_id"] and not np.allclose(first["pose"], second["pose"])

    def own(arrays, record):
        return (arrays["truth_m"] - arrays["pose"][:3, 3]) @ arrays["pose"][:3, :3] / record["scale"]

    np.testing.assert_allclose(own(first, one), own(second, two), atol=1e-5)


def test_a_sample_depends_on_its_object_alone(dataset, catalog, tmp_path):
    """Not on the other objects of the dataset, nor on what was made before it."""
    last = catalog.entries[-1]
    alone = tmp_path / "alone"
    prepare_dataset(alone, type(catalog)(catalog.root, (last,)), SETTINGS)
    there = [entry.object_id for entry in read_objects(dataset).entries].index(last.object_id)
    expected, known = make_sample(str(dataset), 2 * there)
    found, record = make_sample(str(alone), 0)
    assert record == known
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)


def test_another_seed_is_another_dataset_and_zero_is_a_seed(catalog, tmp_path):
    poses = []
    for seed in (0, 1):
        root = tmp_path / str(seed)
        prepare_dataset(root, catalog, SETTINGS.model_copy(update={"seed": seed, "signal": None}))
        poses.append(make_sample(str(root), 0)[0]["pose"])
    assert not np.allclose(*poses)


def test_the_sheet_is_in_the_signal(catalog, tmp_path):
    echoes = []
    for share in (0.0, 1.0):
        root = tmp_path / str(share)
        signal = SignalSettings(occluder=OccluderSettings(sheet_share=share))
        prepare_dataset(root, catalog, SETTINGS.model_copy(update={"signal": signal}))
        arrays, record = make_sample(str(root), 0)
        assert (record["signal"]["sheet"] is None) == (share == 0.0)
        echoes.append(arrays["h"])
    assert np.linalg.norm(echoes[1] - echoes[0]) > 0.01 * np.linalg.norm(echoes[0])


def test_a_mesh_that_changed_is_refused(catalog, tmp_path):
    import shutil

    moved = shutil.copytree(catalog.root, tmp_path / "meshes")
    root = tmp_path / "store"
    prepare_dataset(root, type(catalog)(moved, catalog.entries), SETTINGS)
    path = moved / catalog.entries[0].path
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(MeshError):
        make_sample(str(root), 0)


def test_no_usable_object_is_an_error(catalog, tmp_path):
    import dataclasses

    useless = tuple(dataclasses.replace(entry, reason="no faces") for entry in catalog.entries)
    with pytest.raises(StoreError, match="no usable object"):
        prepare_dataset(tmp_path / "store", type(catalog)(catalog.root, useless), SETTINGS)


@pytest.mark.parametrize("kind", KINDS)
def test_procedural_meshes_are_closed(kind, rng):
    from waveformer.datagen.procedural_meshes import procedural_mesh

    mesh = procedural_mesh(kind, rng)
    assert mesh.is_watertight and mesh.volume > 0 and 0.04 < mesh.extents.max() < 0.31
