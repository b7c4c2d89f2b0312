"""Entries, splits, copies, selections, the file, and loading one object."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
from collections import Counter

import numpy as np
import pytest
import trimesh

from waveformer.datagen.catalog import Catalog, CatalogEntry, load_entry, mark_copies, split_of
from waveformer.datagen.catalog_mesh import file_sha256
from waveformer.simulator.errors import MeshError, StoreError


def entry(name: str = "cup", **changes: object) -> CatalogEntry:
    shape = hashlib.sha256(name.encode()).hexdigest()
    fields: dict[str, object] = {
        "object_id": f"folder/{name}",
        "source": "folder",
        "category": "cups",
        "path": f"{name}.ply",
        "sha256": "00",
        "geometry_sha256": shape,
        "faces": 80,
        "watertight": True,
        "unit_m": 0.001,
        "up_axis": "y",
        "longest_side_m": 0.1,
        "licence": "CC0",
        "split": split_of(shape),
    }
    return CatalogEntry(**{**fields, **changes})  # type: ignore[arg-type]


def test_a_catalogue_comes_back_from_its_file(tmp_path):
    entries = (
        entry("cup", problems=("dropped 2 faces", "open")),
        entry("größe_🍵", unit_m=None, longest_side_m=0.25),
        entry("bad", sha256="", geometry_sha256="", reason="holds no geometry"),
    )
    catalog = Catalog(tmp_path / "meshes", entries)
    catalog.write(tmp_path / "catalog.parquet")
    again = Catalog.read(tmp_path / "catalog.parquet")
    assert again == catalog
    with pytest.raises(StoreError, match="exists; pass --force"):
        catalog.write(tmp_path / "catalog.parquet")
    unknown = Catalog(tmp_path, (entry("cup", unit_m=None, longest_side_m=math.nan),))
    unknown.write(tmp_path / "catalog.parquet", overwrite=True)
    assert math.isnan(Catalog.read(tmp_path / "catalog.parquet").entries[0].longest_side_m)


def test_meshes_and_catalogue_may_move_together(tmp_path):
    folder = tmp_path / "first"
    (folder / "meshes").mkdir(parents=True)
    Catalog(folder / "meshes", (entry(),)).write(folder / "catalog.parquet")
    folder.rename(tmp_path / "second")
    moved = tmp_path / "second/catalog.parquet"
    assert Catalog.read(moved).root.resolve() == (tmp_path / "second/meshes").resolve()
    assert Catalog.read(moved, root="elsewhere").root.name == "elsewhere"


def test_other_files_are_refused(tmp_path):
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "a.parquet"
    refused(path, "does not exist")
    path.write_bytes(b"PAR1 and so on")
    refused(path, "is no catalogue, or damaged")
    pq.write_table(pa.table({"a": [1]}), path)
    refused(path, "but no catalogue")
    Catalog(tmp_path, (entry(),)).write(path, overwrite=True)
    table = pq.read_table(path)
    newer = {**table.schema.metadata, b"waveformer.version": b"2"}
    pq.write_table(table.replace_schema_metadata(newer), path)
    refused(path, "a catalogue of version 2, this program reads 1")
    pq.write_table(table.drop_columns(["faces"]), path)
    refused(path, "lacks columns")


def refused(path, words):
    with pytest.raises(StoreError, match=words) as caught:
        Catalog.read(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"object_id": ""},
        {"object_id": "a\nb"},
        {"split": "test"},
        {"up_axis": "w"},
        {"unit_m": -1.0},
        {"unit_m": math.nan},
    ],
)
def test_entries_are_validated(changes):
    with pytest.raises(StoreError):
        entry(**changes)


def test_names_are_unique():
    with pytest.raises(StoreError, match="two objects of the catalogue are called folder/cup"):
        Catalog(".", (entry(), entry()))


def test_four_of_five_shapes_are_for_training_however_many_there_are():
    splits = [split_of(hashlib.sha256(str(number).encode()).hexdigest()) for number in range(10_000)]
    # A binomial count of 10,000 has a standard deviation of 40.
    assert abs(splits.count("train") - 8000) < 160
    # Pinned: another hash would move objects from evaluation to training in every catalogue there is.
    assert "".join(split[0] for split in splits[:20]) == PINNED_SPLITS


PINNED_SPLITS = "ttttttettttettttttte"


def test_copies_are_refused_after_the_first_and_share_its_split():
    shape = entry("cup").geometry_sha256
    copy = entry("copy", geometry_sha256=shape, split=split_of(shape))
    broken = [entry(name, geometry_sha256="", reason="broken") for name in ("a", "b")]
    marked = mark_copies([broken[0], entry("cup"), entry("pan"), copy, broken[1]])
    assert [item.reason for item in marked] == ["broken", "", "", "duplicate of folder/cup", "broken"]
    assert marked[1].split == marked[3].split


def test_shapes_of_a_held_out_catalogue_are_refused():
    held_out = Catalog(".", (entry("mug", geometry_sha256=entry("cup").geometry_sha256),))
    marked = mark_copies([entry("cup"), entry("pan")], [held_out])
    assert marked[0].reason == "kept out: the same shape as folder/mug of a held-out catalogue"
    assert marked[1].reason == ""


def test_selections():
    entries = [
        entry(f"{category}{number}", source=source, category=category)
        for category, source in (("cups", "folder"), ("pans", "ycb"))
        for number in range(200)
    ]
    catalog = Catalog(".", (*entries, entry("bad", reason="broken", category="bad")))
    assert len(catalog.select().entries) == 400
    assert {item.source for item in catalog.select(sources=["ycb"]).entries} == {"ycb"}
    assert {item.category for item in catalog.select(categories={"cups"}).entries} == {"cups"}
    train = catalog.select(splits=["train"]).entries
    assert {item.split for item in train} == {"train"}
    few = catalog.select(limit=50)
    assert list(few.entries) == [item for item in catalog.entries if item in few.entries]
    assert set(few.entries) < set(catalog.select(limit=100).entries)
    # Hypergeometric: 25 +- 3.3.
    assert abs(Counter(item.category for item in few.entries)["cups"] - 25) < 12
    with pytest.raises(StoreError, match=r"no usable object of category 'bad'; it has cups, pans"):
        catalog.select(categories=["bad"])
    with pytest.raises(StoreError, match="limit must be at least 1"):
        catalog.select(limit=0)


@pytest.fixture
def stored(tmp_path):
    """A ball of 50 mm radius on the disk, and its entry."""
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=50.0).apply_scale([1, 0.8, 0.5])
    mesh.apply_translation([100, 0, 0]).export(tmp_path / "cup.ply")
    return tmp_path, entry(sha256=file_sha256(tmp_path / "cup.ply"))


def test_loading_an_object(stored):
    root, item = stored
    mesh = load_entry(item, root)
    assert mesh.name == "folder/cup"
    np.testing.assert_allclose(mesh.extent_m, [0.1, 0.05, 0.08], rtol=0.03)
    np.testing.assert_allclose(mesh.vertices_m.max(axis=0), -mesh.vertices_m.min(axis=0), atol=1e-12)
    assert load_entry(dataclasses.replace(item, unit_m=None), root).extent_m.max() == pytest.approx(1.0)


def test_an_object_is_loaded_only_as_catalogued(stored):
    root, item = stored
    cases = {
        "mesh.unusable": dataclasses.replace(item, reason="broken"),
        "mesh.missing": dataclasses.replace(item, path="none.ply"),
        "mesh.changed": dataclasses.replace(item, sha256="11"),
    }
    (root.parent / "secret.ply").write_bytes((root / "cup.ply").read_bytes())
    os.symlink(root.parent / "secret.ply", root / "link.ply")
    for code, case in (
        *cases.items(),
        ("mesh.unreadable", dataclasses.replace(item, path="../secret.ply")),
        ("mesh.unreadable", dataclasses.replace(item, path="link.ply")),
    ):
        with pytest.raises(MeshError) as caught:
            load_entry(case, root)
        assert caught.value.code == code
        assert str(caught.value).startswith("folder/cup: ")
