"""Readers on trees built as the collections lie on the disk, with extra nesting and what goes wrong there."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from waveformer.datagen.catalog_items import CatalogItem, walk_files
from waveformer.datagen.catalog_sources import READERS, read_source
from waveformer.simulator.errors import StoreError

UID = "8476c4170df24cf5bbe6967222d1a42d"
OTHER_UID = "00" * 16
PAGE = b"<!DOCTYPE html><html>404</html>"


@pytest.fixture
def put(tmp_path: Path) -> Callable[..., bytes]:
    """Writes a file below the collection: the given bytes, or a ball in the format of the name."""

    def write(path: str, data: bytes | None = None) -> bytes:
        target = tmp_path / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if data is None:
            exported = trimesh.creation.icosphere(subdivisions=1).export(file_type=target.suffix[1:])
            data = exported if isinstance(exported, bytes) else exported.encode()
        target.write_bytes(data)
        return data

    return write


def read(root: Path, source: str) -> dict[str, CatalogItem]:
    items = list(read_source(root, source))
    assert len({item.object_id for item in items}) == len(items)
    return {item.object_id: item for item in items}


def test_omniobject3d(tmp_path: Path, put: Callable[..., bytes]) -> None:
    put("raw_scans/apple/apple_001/Scan/Scan.obj")
    put("raw_scans/apple/apple_001/Scan/Scan.mtl", b"newmtl x")
    put("raw_scans/apple/apple_001/Scan/Scan.jpg", b"\xff\xd8\xff")
    put("raw_scans/toy_car/toy_car/toy_car_012/Scan/Scan.obj")  # unpacked into a folder of its own
    put("raw_scans/misc/strange/scan/scan.OBJ")
    put("raw_scans/broccoli.tar.gz", b"\x1f\x8b")
    put("blender_renders/apple/apple_001/render/transforms.json", b"{}")
    put("point_clouds/ply_files/1024/apple/apple_001/pcd_1024.ply", b"ply")
    items = read(tmp_path, "omniobject3d")
    assert sorted(items) == ["apple_001", "strange", "toy_car_012"]
    assert items["apple_001"].category == "apple"
    assert items["toy_car_012"].category == "toy_car"
    assert items["strange"].category == "misc"
    for item in items.values():
        assert (item.unit_m, item.up_axis, item.licence, item.reason) == (None, "y", "CC-BY-4.0", "")


def test_omniobject3d_without_scans_says_what_is_there_instead(
    tmp_path: Path, put: Callable[..., bytes]
) -> None:
    put("point_clouds/hdf5_files/1024/apple_1024.hdf5", b"\x89HDF")
    refused(tmp_path, "omniobject3d", "point clouds, which have no surface: get raw_scans")
    put("raw_scans/apple.tar.gz", b"\x1f\x8b")
    refused(tmp_path, "omniobject3d", "unpack those of raw_scans first")


def test_toys4k(tmp_path: Path, put: Callable[..., bytes]) -> None:
    put("toys4k_obj_files/airplane/airplane_010/mesh.obj")
    put("toys4k_obj_files/toys4k_obj_files/ice_cream/ice_cream_003/mesh.obj")
    put("toys4k_obj_files/airplane/airplane_011/airplane_011.blend", b"BLENDER")
    put("toys4k_obj_files/airplane/airplane_011/airplane_011_attribution.txt", b"by")
    put("pointclouds/airplane/airplane_010/pc10K.npz", b"PK")
    items = read(tmp_path, "toys4k")
    assert sorted(items) == ["airplane_010", "airplane_011", "ice_cream_003"]
    assert items["ice_cream_003"].category == "ice_cream"
    assert (items["airplane_010"].up_axis, items["airplane_010"].unit_m) == ("y", None)
    assert items["airplane_010"].reason == ""
    assert "only a Blender project (.blend), no mesh.obj" in items["airplane_011"].reason


def test_toys4k_with_blend_files_only_is_said_plainly(tmp_path: Path, put: Callable[..., bytes]) -> None:
    put("pointclouds/airplane/airplane_010/pc10K.npz", b"PK")
    refused(tmp_path, "toys4k", "public release, point clouds without meshes")
    for number in range(3):
        put(f"toys4k_obj_files/airplane/airplane_{number:03}/airplane_{number:03}.blend", b"BLENDER")
    refused(tmp_path, "toys4k", "3 Blender projects (.blend) instead")


def test_objaverse(tmp_path: Path, put: Callable[..., bytes]) -> None:
    base = "home/.objaverse/hf-objaverse-v1"  # hidden folders count above the root, not below
    root = tmp_path / base
    put(f"{base}/glbs/000-023/{UID}.glb")
    put(f"{base}/glbs/000-023/thumbnail.glb")
    put(f"{base}/glbs/000-101/{OTHER_UID}.glb", PAGE)
    put(f"{base}/object-paths.json.gz", gzip.compress(b"{}"))
    put(f"{base}/lvis-annotations.json.gz", gzip.compress(json.dumps({"mug": [UID]}).encode()))
    licences = {UID: {"license": "by-nc", "name": "x"}}
    put(f"{base}/metadata/000-023.json.gz", gzip.compress(json.dumps(licences).encode()))
    for folder in (root, root / "glbs", root / "glbs/000-023", root.parent):
        item = read(folder, "objaverse")[UID]
        assert (item.category, item.licence) == ("mug", "by-nc"), folder
        assert (item.up_axis, item.unit_m, item.reason) == ("y", None, "")
    items = read(root, "objaverse")
    assert "no Sketchfab uid" in items["thumbnail"].reason
    assert (items[OTHER_UID].category, items[OTHER_UID].licence) == ("", "")


def test_objaverse_index_files_alone_or_damaged(tmp_path: Path, put: Callable[..., bytes]) -> None:
    put("object-paths.json.gz", gzip.compress(b"{}"))
    refused(tmp_path, "objaverse", "index files only: download objects first")
    put(f"glbs/000-000/{UID}.glb")
    for damage in (
        b"",
        b"\x1f\x8bnoise",
        gzip.compress(b"[1]"),
        gzip.compress(b"{")[:-3],
        gzip.compress(b"\xff{"),
    ):
        put("lvis-annotations.json.gz", damage)
        refused(tmp_path, "objaverse", "lvis-annotations.json.gz is not an Objaverse index file", "again")


def thingiverse_table(path: Path, rows: list[tuple[str, str, str]]) -> None:
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    identifiers, licences, hashes = zip(*rows, strict=True)
    columns = {
        "fileIdentifier": identifiers,
        "source": ["thingiverse"] * len(rows),
        "license": licences,
        "fileType": ["stl"] * len(rows),
        "sha256": hashes,
        "metadata": ["{}"] * len(rows),
    }
    pq.write_table(pa.table(columns), path)


def test_thingiverse(tmp_path: Path, put: Callable[..., bytes]) -> None:
    data = put("thingiverse/thing-34-file-112.stl")
    put("thingiverse/extra/thing-34-file-113.STL", PAGE)
    put("thingiverse/holder.stl")
    sha256 = hashlib.sha256(data).hexdigest()
    thingiverse_table(
        tmp_path / "thingiverse/thingiverse.parquet",
        [
            ("https://www.thingiverse.com/thing:34/files?fileId=112", "CC BY", sha256.upper()),
            ("https://www.thingiverse.com/thing:99/files?fileId=1", "CC BY", "0"),
            ("nonsense", "CC BY", "0"),
        ],
    )
    items = read(tmp_path, "thingiverse")
    item = items["thing-34-file-112"]
    assert (item.expected_sha256, item.licence, item.unit_m, item.up_axis) == (sha256, "CC BY", 1e-3, "z")
    assert (item.reason, item.notes) == ("", ())
    assert items["thing-34-file-113"].notes == (
        "not in thingiverse.parquet, so its licence and SHA-256 are unknown",
    )
    assert "its name is not thing-" in items["thingiverse/holder.stl"].reason


def test_thingiverse_without_table_or_with_a_damaged_one(tmp_path: Path, put: Callable[..., bytes]) -> None:
    put("holder.stl")
    refused(tmp_path, "thingiverse", "--source folder")
    put("thing-1-file-2.stl")
    assert "there is no thingiverse.parquet" in read(tmp_path, "thingiverse")["thing-1-file-2"].notes[0]
    put("thingiverse.parquet", PAGE)
    refused(tmp_path, "thingiverse", "thingiverse.parquet cannot be read", "download it again")


def test_ycb(tmp_path: Path, put: Callable[..., bytes]) -> None:
    for name in ("textured.obj", "textured.mtl", "nontextured.ply", "nontextured.stl", "kinbody.xml"):
        put(f"models/ycb/003_cracker_box/google_16k/{name}", b"x")
    put("models/ycb/003_cracker_box/poisson/nontextured.ply", b"x")
    put("models/ycb/027-skillet/027_skillet/google_16k/textured.obj", b"x")  # misspelt, and nested
    put("models/ycb/041_small_marker/tsdf/textured.obj", b"x")
    put("models/ycb/023_wine_glass/clouds/merged_cloud.ply", b"x")
    put("models/ycb/063-a_marbles/google_16k/nontextured.stl", b"x")
    put("models/ycb/056_tennis_ball/mesh.ply", b"x")
    put("models/ycb/objects.json", b"{}")
    items = read(tmp_path, "ycb")
    assert sorted(items) == [
        *("003_cracker_box", "023_wine_glass", "027_skillet", "041_small_marker", "056_tennis_ball"),
        "063-a_marbles",
    ]
    box = items["003_cracker_box"]
    assert box.path == "models/ycb/003_cracker_box/google_16k/nontextured.ply"
    assert (box.category, box.unit_m, box.up_axis, box.licence) == ("cracker_box", 1.0, "z", "CC-BY-4.0")
    assert items["027_skillet"].path.endswith("google_16k/textured.obj")
    assert items["041_small_marker"].notes == ("no Google scan here: another mesh stands in",)
    assert "Google has not scanned every YCB object" in items["023_wine_glass"].reason
    assert "a heap" in items["063-a_marbles"].notes[0]
    assert items["056_tennis_ball"].path.endswith("mesh.ply")


def test_folder(tmp_path: Path, put: Callable[..., bytes]) -> None:
    put("cups/cup.stl")
    put("cups/cup.obj")
    put("plate.PLY", b"x")
    put("cups/notes.txt", b"x")
    put("cups/._cup.stl", b"x")
    put("more.zip", b"PK")
    put("old.fbx", b"x")
    items = read(tmp_path, "folder")
    assert sorted(items) == ["cups/cup.obj", "cups/cup.stl", "more.zip", "old.fbx", "plate.PLY"]
    assert items["cups/cup.stl"].category == "cups"
    assert (items["plate.PLY"].category, items["plate.PLY"].unit_m) == ("", None)
    assert "unpack it" in items["more.zip"].reason
    assert ".fbx is not read: export it as one of glb" in items["old.fbx"].reason


def test_table(tmp_path: Path, put: Callable[..., bytes]) -> None:
    rows = [
        "object_id,file,set,category,licence,unit_m,up_axis,real_scale,extra",
        "cup,a/cup.stl,kitchen,mugs,CC0,0.001,y,1,?",
        "pan,a/pan.stl,kitchen,,,,,1,?",
        "toy,a/toy.stl,,,,,,0,?",
        "out,../secret.stl,x,,,,,,",
        "root,/etc/passwd,x,,,,,,",
        "unit,a.stl,x,,,mm,,,",
        "axis,a.stl,x,,,,up,,",
        "short",
    ]
    put("INDEX.csv", "\n".join(rows).encode())
    items = read(tmp_path, "table")
    cup = items["cup"]
    assert (cup.source, cup.path, cup.category, cup.licence) == ("kitchen", "a/cup.stl", "mugs", "CC0")
    assert (cup.unit_m, cup.up_axis, cup.reason) == (0.001, "y", "")
    assert (items["pan"].unit_m, items["pan"].up_axis) == (1.0, "z")
    assert (items["toy"].unit_m, items["toy"].source) == (None, "table")
    assert "leads out of the catalogue's folder" in items["out"].reason
    assert "leads out of the catalogue's folder" in items["root"].reason
    assert "unit_m is 'mm', not a positive number" in items["unit"].reason
    assert "up_axis is 'up', not x, y or z" in items["axis"].reason
    assert "names no object_id or no file" in items["short"].reason


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "no column object_id, file; it has none"),
        (b"object_id,path\n", "no column file; it has object_id, path"),
        (b"object_id,file\n", "has no rows"),
        (b"object_id,file\n\xff\xfe,a\n", "not a CSV table in UTF-8"),
        (b'object_id,file\n"' + b"x" * 200_000, "not a CSV table in UTF-8"),
    ],
)
def test_damaged_tables(tmp_path: Path, put: Callable[..., bytes], data: bytes, expected: str) -> None:
    refused(tmp_path, "table", "holds no INDEX.csv")
    put("INDEX.csv", data)
    refused(tmp_path, "table", expected)


def test_the_shared_table(shared_meshes: Path) -> None:
    items = list(read_source(shared_meshes, "table"))
    assert len(items) == 1672
    assert {item.unit_m for item in items if item.source == "ycb"} == {1.0}
    assert {item.unit_m for item in items if item.source == "kaykit_cc0"} == {None}
    assert not any(item.reason for item in items)


@pytest.mark.parametrize("source", READERS)
def test_a_folder_of_something_else_is_refused_in_one_line(tmp_path: Path, source: str) -> None:
    (tmp_path / "notes.txt").write_text("x")
    refused(tmp_path, source, str(tmp_path))


def test_an_unknown_source_and_no_folder(tmp_path: Path) -> None:
    refused(tmp_path, "shapenet", "unknown source 'shapenet'; known: omniobject3d, toys4k")
    refused(tmp_path / "none", "folder", "is not a folder")


def test_walking_is_ordered_and_follows_no_link_out(tmp_path: Path, put: Callable[..., bytes]) -> None:
    put("outside/secret.stl", b"x")
    for path in ("root/b/2.stl", "root/b/1.stl", "root/a/3.stl", "root/z.stl", "root/a/b/4.stl"):
        put(path, b"x")
    root = tmp_path / "root"
    os.symlink(tmp_path / "outside", root / "link")
    os.symlink("a", root / "again")
    os.symlink("b/1.stl", root / "one.stl")
    os.symlink("nowhere", root / "broken")
    found = [(item.path, item.reason) for item in walk_files(root)]
    assert [path for path, _ in found] == [
        *("broken", "one.stl", "z.stl", "a/3.stl", "a/b/4.stl", "b/1.stl", "b/2.stl", "link")
    ]
    reasons = {path: reason for path, reason in found if reason}
    assert sorted(reasons) == ["broken", "link"]
    assert "leads out of the catalogue's folder" in reasons["link"]


def refused(root: Path, source: str, *words: str) -> None:
    with pytest.raises(StoreError) as caught:
        list(read_source(root, source))
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
