"""load_mesh: what is refused and with which words, what is repaired, what is two-sided."""

from __future__ import annotations

import csv
import logging
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.mesh_files import MAX_FILE_BYTES, read_triangles

FORMATS = ("stl", "ply", "obj", "off", "glb")


def ball(radius_m: float = 0.05) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=2, radius=radius_m)


def file_bytes(mesh: Any, file_format: str, **options: Any) -> bytes:
    data = mesh.export(file_type=file_format, **options)
    return data if isinstance(data, bytes) else data.encode()


def soup(vertices: Any, faces: Any) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.array(vertices, float), np.array(faces), process=False)


def refusal(source: Any, code: str, *words: str, **options: Any) -> str:
    """The message of the refusal: one line, with the code, the file's name and the remedy."""
    with pytest.raises(MeshError) as caught:
        load_mesh(source, **options)
    message = str(caught.value)
    assert caught.value.code == code, message
    assert len(message.splitlines()) == 1
    assert len(message) < 400
    for word in words:
        assert word in message
    return message


def refused_file(folder: Path, name: str, data: bytes, code: str, *words: str) -> str:
    path = folder / name
    path.write_bytes(data)
    return refusal(path, code, name, *words)


@pytest.mark.parametrize("file_format", FORMATS)
def test_every_format_gives_the_same_closed_ball(tmp_path: Path, file_format: str) -> None:
    path = tmp_path / f"ball.{file_format}"
    path.write_bytes(file_bytes(ball(), file_format))
    for source in (path, str(path)):
        mesh = load_mesh(source)
        assert mesh.name == path.name
        assert not mesh.two_sided
        assert mesh.problems == ()
        assert mesh.faces.shape == (320, 3)
        assert len(mesh.vertices_m) == 162
        assert mesh.extent_m == pytest.approx([0.1, 0.1, 0.1], rel=1e-6)
        assert mesh.areas_m2.sum() == pytest.approx(ball().area, rel=1e-5)
        assert (np.einsum("ij,ij->i", mesh.normals, mesh.triangles_m.mean(axis=1)) > 0).all()


def test_a_clean_mesh_is_not_changed_and_not_shared() -> None:
    source = ball()
    mesh = load_mesh(source)
    assert np.array_equal(mesh.faces, source.faces)
    assert np.array_equal(mesh.vertices_m, source.vertices)
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices_m[0] = 0
    source.vertices[0] = 0  # the caller's mesh stays writable


def test_importing_the_module_does_not_load_trimesh() -> None:
    code = "import sys, waveformer.simulator.mesh; sys.exit('trimesh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_scene_nodes_are_placed_and_a_mirrored_one_keeps_its_outside() -> None:
    scene = trimesh.Scene()
    half_x = np.diag([0.5, 1, 1, 1.0])
    mirror = np.diag([-1, 1, 1, 1.0])
    mirror[0, 3] = 0.5
    scene.add_geometry(ball(), geom_name="ball", transform=half_x)
    scene.graph.update(frame_to="again", geometry="ball", matrix=mirror)
    scene.add_geometry(trimesh.PointCloud(np.random.default_rng(0).random((9, 3))))
    mesh = load_mesh(scene)
    assert mesh.extent_m == pytest.approx([0.575, 0.1, 0.1])
    assert not mesh.two_sided
    assert mesh.problems == ("ignored 1 parts without faces (points or lines)",)


def test_unit_scales() -> None:
    assert load_mesh(ball(50.0), unit_m=1e-3).extent_m == pytest.approx([0.1, 0.1, 0.1])
    refusal(ball(), "mesh.unit", "unit_m", unit_m=0.0)
    refusal(ball(), "mesh.unit", "unit_m", unit_m="mm")


def test_missing_unreadable_and_unknown_sources(tmp_path: Path) -> None:
    refusal(tmp_path / "none.stl", "mesh.missing", "none.stl", "check the path")
    refusal("a\0b.stl", "mesh.missing")
    refusal("x" * 5000 + ".stl", "mesh.missing")
    refusal(tmp_path, "mesh.unreadable", "not a regular file")
    refusal(np.zeros((3, 3)), "mesh.unreadable", "ndarray")
    refused_file(
        tmp_path, "a.fbx", b"Kaydara", "mesh.unreadable", ".fbx", "supported: glb, gltf, obj, off, ply, stl"
    )
    refused_file(tmp_path, "noext", b"?", "mesh.unreadable", "no file extension")
    refused_file(tmp_path, "a.stl", b"<!DOCTYPE html><p>404", "mesh.unreadable", "web page")
    refused_file(tmp_path, "b.stl", b"hello", "mesh.unreadable", "neither a text nor a binary STL")


def test_a_file_name_with_a_line_break_stays_one_line(tmp_path: Path) -> None:
    path = tmp_path / "two\nlines.stl"
    path.write_bytes(b"")
    refusal(path, "mesh.empty", "two lines.stl")


def test_a_misnamed_file_is_read_by_its_signature(tmp_path: Path) -> None:
    for file_format in ("ply", "glb"):
        path = tmp_path / f"{file_format}.stl"
        path.write_bytes(file_bytes(ball(), file_format))
        assert len(load_mesh(path).faces) == 320


def test_other_files_under_a_mesh_name_are_told_apart(tmp_path: Path) -> None:
    refused_file(tmp_path, "a.obj", b"BLENDER-v293", "mesh.unreadable", "Blender project", "export a mesh")
    refused_file(tmp_path, "a.glb", b"\x89PNG\r\n", "mesh.unreadable", "a picture")
    refused_file(tmp_path, "a.ply", b"version https://git-lfs.x", "mesh.unreadable", "git lfs pull")


def test_reasons_speak_of_the_file_not_of_the_parser(tmp_path: Path) -> None:
    buffer = b'"buffers": [{"uri": "../secret.bin", "byteLength": 9}]'
    tree = b'{"asset": {"version": "2.0"}, %s, "bufferViews": [{"buffer": 0, "byteLength": 9}], "meshes": 7}'
    refused_file(tmp_path, "a.gltf", tree % buffer, "mesh.unreadable", "a file outside of its own folder")
    refused_file(tmp_path, "b.gltf", tree % b'"x": 1', "mesh.truncated", "does not follow the format")
    text = b"v 0 0 0\nv 1 0 0\nv 0 one 0\nf 1 2 3\n"
    refused_file(tmp_path, "c.obj", text, "mesh.truncated", "less or more data than it declares")
    refused_file(
        tmp_path, "d.off", b"OFF\nthree 1 0\n", "mesh.truncated", "'three' stands where a number must"
    )


def test_what_was_read_can_be_loaded_later(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(file_bytes(ball(), "ply"))
    raw = read_triangles(path)
    assert np.array_equal(load_mesh(raw, unit_m=0.5).vertices_m, load_mesh(path, unit_m=0.5).vertices_m)


def test_archives_and_giants_are_refused_unread(tmp_path: Path) -> None:
    refused_file(tmp_path, "a.zip", b"PK\x03\x04", "mesh.archive", "unpack")
    refused_file(tmp_path, "a.tar.gz", b"\x1f\x8b", "mesh.archive", "unpack")
    refused_file(tmp_path, "tar.obj", b"cup.obj".ljust(257, b"\0") + b"ustar\0v 0 0 0", "mesh.archive")
    refused_file(tmp_path, "disguised.obj", b"PK\x03\x04 and so on", "mesh.archive", "unpack")
    giant = tmp_path / "giant.stl"
    with giant.open("wb") as file:
        file.truncate(MAX_FILE_BYTES + 1)  # sparse, takes no space
    refusal(giant, "mesh.too_big_file", "giant.stl", "2 GB", "simplify")


@pytest.mark.parametrize("fraction", [0.95, 0.6, 0.1, 0.01])
@pytest.mark.parametrize("kind", ["a.stl", "text.stl", "a.ply", "text.ply", "a.glb", "a.off"])
def test_truncated_files_are_recognised(tmp_path: Path, kind: str, fraction: float) -> None:
    if kind == "text.stl":
        text = trimesh.exchange.stl.export_stl_ascii(ball())
        data = (text + text).encode()  # two solids: the first one is complete
    elif kind == "text.ply":
        data = file_bytes(ball(), "ply", encoding="ascii")
    else:
        data = file_bytes(ball(), kind[-3:])
    refused_file(tmp_path, kind, data[: int(len(data) * fraction)], "mesh.truncated", "get or export")


def test_truncated_obj_and_gltf(tmp_path: Path) -> None:
    obj = file_bytes(ball(), "obj")
    refused_file(tmp_path, "face.obj", obj[: obj.rfind(b" ")], "mesh.truncated", "last line")
    refused_file(tmp_path, "vertices.obj", obj[: obj.find(b"\nf ")], "mesh.no_faces", "point cloud")
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(ball()))
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    assert len(load_mesh(tmp_path / "model.gltf").faces) == 320
    buffer = next(path for path in tmp_path.glob("*.bin"))
    data = buffer.read_bytes()
    buffer.write_bytes(data[:50])
    assert "model.gltf" in refusal(tmp_path / "model.gltf", "mesh.truncated")
    outside = (tmp_path / "model.gltf").read_bytes().replace(buffer.name.encode(), b"../../secret.bin")
    refused_file(tmp_path, "outside.gltf", outside, "mesh.unreadable", "cannot be read")
    compressed = b'{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}'
    refused_file(tmp_path, "draco.gltf", compressed, "mesh.unreadable", "without compression")


def test_damaged_text_is_not_read_halfway(tmp_path: Path) -> None:
    refused_file(tmp_path, "a.obj", b"v 0 x 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "mesh.truncated")
    refused_file(tmp_path, "b.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3x\nf 1 2 3\n", "mesh.truncated")
    relative = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\n"
    refused_file(tmp_path, "c.obj", relative, "mesh.unreadable", "absolute vertex numbers")
    header = b"ply\nformat ascii 1.0\nelement vertex 2000000000\nproperty float x\nproperty float y\n"
    refused_file(tmp_path, "d.ply", header + b"property float z\nend_header\n0 0 0\n", "mesh.no_faces")
    claims = file_bytes(ball(), "stl")
    refused_file(tmp_path, "e.stl", claims[:80] + b"\0\0\0\xee" + claims[84:], "mesh.truncated")
    refused_file(tmp_path, "f.stl", claims + b"\0" * 9, "mesh.unreadable", "9 bytes more")


def test_no_geometry(tmp_path: Path) -> None:
    for suffix in FORMATS:
        refused_file(tmp_path, f"a.{suffix}", b"", "mesh.empty", "the file is empty")
    refused_file(tmp_path, "comment.obj", b"# nothing\n", "mesh.empty", "no geometry")
    refusal(trimesh.Scene(), "mesh.empty")
    cloud = trimesh.PointCloud(np.eye(3))
    refused_file(tmp_path, "cloud.ply", file_bytes(cloud, "ply"), "mesh.no_faces", "point cloud", "triangles")
    refusal(cloud, "mesh.no_faces", "mesh with triangles")


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf"])
def test_non_finite_vertices_are_counted_not_dropped(tmp_path: Path, bad: str) -> None:
    vertices = ball().vertices.copy()
    vertices[[3, 8], [0, 2]] = float(bad)
    broken = soup(vertices, ball().faces)
    refusal(broken, "mesh.nonfinite", "2 of 162 vertices", "re-export")
    refused_file(tmp_path, "a.ply", file_bytes(broken, "ply"), "mesh.nonfinite", "2 of 162")
    refused_file(tmp_path, "a.obj", file_bytes(broken, "obj"), "mesh.nonfinite", "2 of 162")
    good = trimesh.exchange.stl.export_stl_ascii(ball())
    text = trimesh.exchange.stl.export_stl_ascii(soup(np.eye(3), [[0, 1, 2]])).replace(
        "vertex 1.0", f"vertex {bad}"
    )
    refused_file(tmp_path, "two_solids.stl", (good + text).encode(), "mesh.nonfinite")


def test_face_index_out_of_range(tmp_path: Path) -> None:
    vertices = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]]
    refusal(soup(vertices, [[0, 1, 3]]), "mesh.index_range", "vertex 3 of 3")
    points = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\n"
    refused_file(tmp_path, "high.obj", points + b"f 1 2 4\n", "mesh.index_range")
    refused_file(tmp_path, "zero.obj", points + b"f 0 1 2\n", "mesh.index_range", "counts from 1")
    ply = bytearray(file_bytes(ball(), "ply"))
    ply[-4:] = (10**6).to_bytes(4, "little")
    refused_file(tmp_path, "a.ply", bytes(ply), "mesh.index_range", "1000000 of 162")
    ply[-4:] = b"\xff\xff\xff\xff"
    refused_file(tmp_path, "b.ply", bytes(ply), "mesh.index_range", "-1 of 162")
    refused_file(tmp_path, "a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "mesh.index_range")


def test_wrong_unit_is_named() -> None:
    refusal(ball(50.0), "mesh.too_large", "100 m", "in mm?", "unit_m=0.001", "--unit mm")
    refusal(ball(5.0), "mesh.too_large", "10 m", "unit_m=0.01", "--unit cm")
    refusal(ball(1e30), "mesh.too_large", "scale it")
    refusal(soup(np.diag([1e308, -1e308, 1e308]), [[0, 1, 2]]), "mesh.too_large", "scale it")
    refusal(ball(1e-4), "mesh.too_small", "0.0002 m", "scale it")
    refusal(ball(0.05), "mesh.too_small", "in m?", "--unit m", unit_m=1e-3)


def test_zero_area() -> None:
    refusal(soup(np.ones((3, 3)), [[0, 1, 2]]), "mesh.zero_area", "zero area")
    refusal(soup([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], [[0, 1, 2]]), "mesh.zero_area")
    refusal(soup(np.eye(3), [[0, 0, 1], [1, 2, 2]]), "mesh.zero_area")


def test_repairs_are_made_and_recorded() -> None:
    source = ball()
    faces = source.faces.tolist()
    faces += [faces[7][1:] + faces[7][:1], faces[9], [4, 4, 5]]  # twice the same, once collapsed
    vertices = np.vstack([source.vertices, [[9.0, 9.0, 9.0]]])  # a stray point no face uses
    mesh = load_mesh(soup(vertices, faces))
    assert np.array_equal(mesh.faces, source.faces)
    assert mesh.extent_m == pytest.approx([0.1, 0.1, 0.1])
    assert mesh.problems == ("dropped 1 zero-area faces", "dropped 2 duplicate faces")
    assert not mesh.two_sided


def test_triangle_soup_is_merged_back_even_with_rounding(rng: np.random.Generator) -> None:
    source = ball()
    corners = source.triangles.reshape(-1, 3)
    corners = corners + rng.uniform(-1e-16, 1e-16, corners.shape)
    mesh = load_mesh(soup(corners, np.arange(len(corners)).reshape(-1, 3)))
    assert len(mesh.vertices_m) == 162
    assert not mesh.two_sided


def test_a_sheet_with_a_back_keeps_one_side() -> None:
    vertices = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]
    mesh = load_mesh(soup(vertices, [[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert mesh.two_sided
    assert mesh.problems == ("dropped 2 faces that were the back of another (a two-sided sheet)",)


def test_a_sliver_does_not_open_a_closed_body() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    a, b, c = box.faces[0]
    middle = (box.vertices[a] + box.vertices[b]) / 2
    # The first face is split at the middle of an edge, its neighbour is not: a zero-area face closes the gap.
    faces = [*box.faces[1:].tolist(), [a, 8, c], [8, b, c], [a, b, 8]]
    mesh = load_mesh(soup(np.vstack([box.vertices, [middle]]), faces))
    assert not mesh.two_sided
    assert mesh.problems == ("dropped 1 zero-area faces",)


def test_open_and_inconsistent_meshes_reflect_on_both_sides() -> None:
    source = ball()
    assert load_mesh(soup(source.vertices, source.faces[1:])).two_sided
    faces = source.faces.copy()
    faces[0] = faces[0][::-1]
    mesh = load_mesh(soup(source.vertices, faces))
    assert mesh.two_sided
    assert "3 edges join faces wound against each other" in mesh.problems[0]


def test_an_inverted_mesh_is_refused_or_flipped() -> None:
    source = ball()
    inverted = soup(source.vertices, source.faces[:, ::-1])
    inverted.metadata["name"] = "bowl"
    refusal(inverted, "mesh.inverted", "bowl", "turned inside out", "fix_winding=True", "--fix-winding")
    mesh = load_mesh(inverted, fix_winding=True)
    assert np.array_equal(mesh.faces, source.faces)
    assert not mesh.two_sided
    assert mesh.problems == ("flipped 1 of 1 bodies that were turned inside out",)
    refusal(
        trimesh.util.concatenate([inverted, inverted.copy().apply_translation([1, 0, 0])]), "mesh.inverted"
    )


def test_far_from_the_origin_the_volume_keeps_its_sign() -> None:
    assert not load_mesh(ball().apply_translation([100, 200, -300])).two_sided


def test_one_inverted_body_among_others_makes_the_mesh_two_sided() -> None:
    outer, inner = ball(), ball(0.02)
    inner.faces = inner.faces[:, ::-1]
    both = trimesh.util.concatenate([outer, inner.apply_translation([0.2, 0, 0])])
    mesh = load_mesh(both)
    assert mesh.two_sided
    assert mesh.problems[0].startswith("1 of 2 bodies are turned inside out")
    mesh = load_mesh(both, fix_winding=True)
    assert not mesh.two_sided
    outward = mesh.triangles_m.mean(axis=1) - np.where(np.arange(640)[:, None] < 320, 0, [[0.2, 0, 0]])
    assert (np.einsum("ij,ij->i", mesh.normals, outward) > 0).all()


def test_bodies_that_touch_in_an_edge_stay_one_sided() -> None:
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    pair = trimesh.util.concatenate([cube, cube.copy().apply_translation([0.1, 0.1, 0])])
    assert not load_mesh(pair).two_sided


def test_trimesh_prints_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(file_bytes(ball(), "ply")[:-7])
    with pytest.raises(MeshError):
        load_mesh(path)
    assert capfd.readouterr() == ("", "")
    assert not logging.getLogger("trimesh").disabled


def test_random_damage_never_escapes_as_another_error(tmp_path: Path, rng: np.random.Generator) -> None:
    for file_format in FORMATS:
        data = file_bytes(trimesh.creation.icosphere(subdivisions=1, radius=0.05), file_format)
        for _ in range(30):
            damaged = bytearray(data)
            for place in rng.integers(0, min(len(data), 400), 4):
                damaged[place] = rng.integers(256)
            path = tmp_path / f"damaged.{file_format}"
            path.write_bytes(damaged)
            try:
                assert isinstance(load_mesh(path), SurfaceMesh)
            except MeshError as error:
                assert error.code.startswith("mesh.")


def test_a_large_clean_mesh_passes_quickly() -> None:
    source = trimesh.creation.icosphere(subdivisions=7, radius=0.1)
    start = time.process_time()
    mesh = load_mesh(source)
    assert time.process_time() - start < 1.5  # 0.3 s on an idle core; 327 680 faces
    assert not mesh.two_sided


@pytest.mark.slow
def test_the_shared_collection_loads(shared_meshes: Path) -> None:
    with (shared_meshes / "INDEX.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows[:: len(rows) // 200]:
        mesh = load_mesh(shared_meshes / row["file"])
        assert len(mesh.faces) <= int(row["faces"])
        assert mesh.extent_m.max() == pytest.approx(float(row["longest_side_m"]), abs=1e-3)
        if row["watertight"] == "1" and row["winding_ok"] == "1" and not mesh.problems:
            assert not mesh.two_sided
