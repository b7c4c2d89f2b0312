"""Objects from folders, files and tables."""

import pytest

from waveformer.datagen.twin_objects import find_objects
from waveformer.simulator.errors import StoreError

TABLE = "set,object_id,file\nycb,001_a,ycb/a.ply\nother,b,b.ply\nycb,002_c,ycb/c.ply\n"


@pytest.fixture
def folder(tmp_path):
    for name in ("b.ply", "a.stl", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "INDEX.csv").write_text(TABLE)
    return tmp_path


def ids(objects):
    return [item.object_id for item in objects]


def test_a_folder_gives_its_meshes_by_name(folder):
    assert ids(find_objects([folder])) == ["a", "b"]


def test_files_keep_their_order(folder):
    found = find_objects([folder / "b.ply", folder / "a.stl"])
    assert ids(found) == ["b", "a"]
    assert found[0].path == folder / "b.ply"


def test_a_table_names_its_objects(folder):
    found = find_objects([folder / "INDEX.csv"], mesh_set="ycb")
    assert ids(found) == ["001_a", "002_c"]
    assert found[1].path == folder / "ycb/c.ply"
    assert ids(find_objects([folder / "INDEX.csv"], limit=2)) == ["001_a", "b"]


@pytest.mark.parametrize(
    ("text", "mesh_set", "expected"),
    [
        (TABLE, "gso", "no set 'gso'; known: ycb, other"),
        ("object_id,file\na,a.ply\n", "ycb", "no column set; it has object_id, file"),
        ("name,file\na,a.ply\n", None, "no column object_id"),
        ("object_id,file\n", None, "has no rows"),
        ("object_id,file\na\n", None, "row 1 ends before"),
        ("object_id,file\na,a.ply\na,b.ply\n", None, "two objects are called a"),
        ("object_id,file\n../a,a.ply\n", None, "cannot name a folder"),
        ("", None, "it has none"),
    ],
)
def test_bad_tables(tmp_path, text, mesh_set, expected):
    table = tmp_path / "t.csv"
    table.write_text(text)
    with pytest.raises(StoreError, match=expected):
        find_objects([table], mesh_set=mesh_set)


def test_bad_sources(tmp_path):
    with pytest.raises(StoreError, match="holds no mesh file"):
        find_objects([tmp_path])
    with pytest.raises(StoreError, match="does not exist"):
        find_objects([tmp_path / "absent"])
    (tmp_path / "t.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(StoreError, match="not a CSV table"):
        find_objects([tmp_path / "t.csv"])
