"""More than 300 files that pretend to be meshes, written by code, and what a scan must say of each.

`write_hostile_files` returns {path below the folder: verdict}. Verdicts: "good" (usable), "repaired" (usable, with a
problem noted), "refused", "not good" (repaired or refused: what was cut off may leave a smaller mesh), or "any": the
damage may have missed the geometry. A path that ends in "**" stands for what is found anywhere below it.
The files are meant to be scanned in metres.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import os
import socket
import struct
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import trimesh

FORMATS = ("stl", "ply", "obj", "off", "glb")
GOOD, REPAIRED, REFUSED, NOT_GOOD, ANY = "good", "repaired", "refused", "not good", "any"


def write_hostile_files(root: Path, outside: Path) -> dict[str, str]:
    """Write all of them below `root`; `outside` is an existing file that no scan may reach."""
    collection = _Collection(root)
    for family in (
        *(
            _good,
            _repairable,
            _truncated,
            _headers,
            _non_finite,
            _sizes,
            _nothing_to_see,
            _indices,
            _archives,
        ),
        *(_noise, _other_files, _gltf, _obj_text, _ply_text, _stl_text, _off_text),
    ):
        family(collection)
    _file_system(collection, outside)
    return collection.verdicts


class _Collection:
    def __init__(self, root: Path) -> None:
        self.root = root
        self.verdicts: dict[str, str] = {}
        self._count = 0

    def add(self, path: str, data: bytes | str, verdict: str = REFUSED) -> None:
        assert path not in self.verdicts, path
        target = self.root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data.encode() if isinstance(data, str) else data)
        self.verdicts[path] = verdict

    def ball(self) -> trimesh.Trimesh:
        """An ellipsoid like no other of the collection: equal shapes would be refused as duplicates."""
        self._count += 1
        mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.05)
        mesh.apply_scale([1.0, 1.0 - 0.004 * (self._count % 100), 0.55 - 0.03 * (self._count // 100)])
        return mesh


def encode(mesh: trimesh.Trimesh, kind: str) -> bytes:
    if kind == "text.stl":
        return trimesh.exchange.stl.export_stl_ascii(mesh).encode()
    options = {"encoding": "ascii"} if kind == "text.ply" else {}
    data = mesh.export(file_type=kind.split(".")[-1], **options)
    return data if isinstance(data, bytes) else data.encode()


def soup(vertices: object, faces: object) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.array(vertices, float), np.array(faces), process=False)


def _good(files: _Collection) -> None:
    for kind in (*FORMATS, "text.stl", "text.ply"):
        files.add(f"good/ball.{kind}", encode(files.ball(), kind), GOOD)
    files.add("good/misnamed_ply.stl", encode(files.ball(), "ply"), GOOD)
    files.add("good/misnamed_glb.obj", encode(files.ball(), "glb"), GOOD)
    files.add("good/größe_コップ_🍵.stl", encode(files.ball(), "stl"), GOOD)
    files.add(f"good/{'n' * 240}.ply", encode(files.ball(), "ply"), GOOD)
    files.add(f"good/{'deep/' * 60}ball.ply", encode(files.ball(), "ply"), GOOD)
    files.add("good/with spaces 'and' \"quotes\" $HOME;.stl", encode(files.ball(), "stl"), GOOD)
    files.add("good/UPPER.STL", encode(files.ball(), "stl"), GOOD)
    files.add("good/--option.ply", encode(files.ball(), "ply"), GOOD)


def _repairable(files: _Collection) -> None:
    inverted = files.ball()
    inverted.invert()
    for kind in FORMATS:
        files.add(f"repair/inverted.{kind}", encode(_changed(files, inverted), kind), REPAIRED)
    slivers = files.ball()
    faces = [*slivers.faces.tolist(), [4, 4, 5], slivers.faces[3].tolist(), slivers.faces[7][::-1].tolist()]
    for kind in ("ply", "obj", "off"):
        files.add(f"repair/slivers.{kind}", encode(soup(files.ball().vertices, faces), kind), REPAIRED)
    for kind in FORMATS:
        ball = files.ball()
        files.add(f"repair/open.{kind}", encode(soup(ball.vertices, ball.faces[3:]), kind), REPAIRED)
        mixed = files.ball()
        turned = mixed.faces.copy()
        turned[::2] = turned[::2, ::-1]
        files.add(f"repair/mixed_winding.{kind}", encode(soup(mixed.vertices, turned), kind), REPAIRED)
    scene = trimesh.Scene([files.ball(), trimesh.PointCloud(np.random.default_rng(0).random((9, 3)) / 50)])
    files.add("repair/points_beside.glb", scene.export(file_type="glb"), REPAIRED)


def _changed(files: _Collection, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return soup(files.ball().vertices, mesh.faces)


def _truncated(files: _Collection) -> None:
    for kind in (*FORMATS, "text.stl", "text.ply"):
        data = encode(files.ball(), kind)
        # What is left of an OBJ may be a whole file of fewer faces.
        verdict = NOT_GOOD if kind == "obj" else REFUSED
        for percent in (0.1, 1, 3, 8, 15, 25, 40, 50, 60, 75, 90, 97, 99.5):
            files.add(f"cut/{percent:g}.{kind}", data[: int(len(data) * percent / 100)], verdict)
    model, buffer = _gltf_pair(files.ball())
    for percent in (1, 20, 50, 80, 99):
        files.add(f"cut/{percent}.gltf", model[: len(model) * percent // 100])
        (files.root / f"cut/b{percent}.bin").write_bytes(buffer[: len(buffer) * percent // 100])
        files.add(f"cut/buffer{percent}.gltf", model.replace(b"buffer.bin", f"b{percent}.bin".encode()))


def _headers(files: _Collection) -> None:
    stl = encode(files.ball(), "stl")
    for count in (0, 1, 79, 81, 2**31, 2**32 - 1):
        files.add(f"headers/stl_{count}.stl", stl[:80] + struct.pack("<I", count) + stl[84:])
    files.add("headers/stl_solid_binary.stl", b"solid" + stl[5:60] + b"\0" + stl[61:], GOOD)
    for kind in ("ply", "text.ply"):
        ply = encode(files.ball(), kind)
        for old, name in ((b"element vertex 42", "vertex"), (b"element face 80", "face")):
            for count in ("0", "1", "41", "81", "2000000000", "99999999999999999999", "-5", "many", ""):
                changed = ply.replace(old, f"element {name} {count}".encode())
                assert changed != ply
                lax = ANY if (name, count) in (("vertex", "41"), ("face", "1"), ("face", "41")) else REFUSED
                files.add(f"headers/{name}_{count or 'none'}.{kind}", changed, lax)
    glb = encode(files.ball(), "glb")
    for place, name in ((8, "length"), (12, "json_length"), (4, "version")):
        for value in (0, 1, 2**31, 2**32 - 1):
            files.add(
                f"headers/glb_{name}_{value}.glb",
                glb[:place] + struct.pack("<I", value) + glb[place + 4 :],
                ANY,
            )
    for counts in ("0 0 0", "42 0 0", "0 80 0", "42 81 0", "43 80 0", "2000000000 80 0", "-1 -1 0", "x y z"):
        off = encode(files.ball(), "off").replace(b"42 80 0", counts.encode())
        files.add(f"headers/off_{counts.replace(' ', '_')}.off", off)


def _non_finite(files: _Collection) -> None:
    for value in ("nan", "inf", "-inf"):
        for kind in (*FORMATS, "text.stl", "text.ply"):
            mesh = files.ball()
            vertices = np.array(mesh.vertices)
            vertices[7, 1] = float(value)
            files.add(f"nonfinite/{value}.{kind}", encode(soup(vertices, mesh.faces), kind))
    for text in ("1e400", "0x1p3", "1,5", "NaN(7)", "--3", "１", "1e", "1" * 400):
        obj = encode(files.ball(), "obj").decode().replace("\nv ", f"\nv {text} ", 1)
        files.add(f"nonfinite/obj_{text[:10]}.obj", obj, ANY)


def _sizes(files: _Collection) -> None:
    for name, factor in (("millimetres", 1e3), ("huge", 1e30), ("tiny", 1e-6), ("dust", 1e-30)):
        for kind in FORMATS:
            mesh = files.ball()
            mesh.vertices *= factor
            files.add(f"sizes/{name}.{kind}", encode(mesh, kind))
    for kind in ("obj", "off", "text.stl"):
        mesh = files.ball()
        mesh.vertices *= 1e307
        files.add(f"sizes/overflow.{kind}", encode(mesh, kind))
    far = files.ball().apply_scale(0.1)
    far.vertices[3] = [4.5, 0, 0]
    files.add("sizes/stray_vertex.ply", encode(far, "ply"))
    needle = files.ball().apply_scale([1, 1e-4, 1e-4])
    files.add("sizes/needle.ply", encode(needle, "ply"))
    plate = files.ball()
    plate.vertices[:, 2] = 0
    files.add("sizes/plate.ply", encode(plate, "ply"))
    offset = files.ball().apply_translation([1e18, 0, 0])
    files.add("sizes/far_away.obj", encode(offset, "obj"))


def _nothing_to_see(files: _Collection) -> None:
    for kind in (*FORMATS, "gltf"):
        files.add(f"nothing/empty.{kind}", b"")
        files.add(f"nothing/blank.{kind}", b" \n\t\r\n" * 50)
        files.add(f"nothing/zeros.{kind}", bytes(4096))
    files.add("nothing/comment.obj", "# nothing\n" * 20)
    files.add("nothing/points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    files.add("nothing/lines.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\n")
    files.add("nothing/points.ply", encode(trimesh.PointCloud(np.eye(3)), "ply"))
    files.add("nothing/no_facets.stl", "solid nothing\nendsolid nothing\n")
    files.add("nothing/no_triangles.stl", bytes(84))
    files.add("nothing/scene.gltf", '{"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "scene": 0}')
    for kind in FORMATS:
        files.add(f"nothing/one_point.{kind}", encode(soup(np.ones((3, 3)), [[0, 1, 2]]), kind))
        line = soup([[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], [[0, 1, 2]])
        files.add(f"nothing/line.{kind}", encode(line, kind))


def _indices(files: _Collection) -> None:
    for name, face in (
        *(
            ("high", "1 2 43"),
            ("zero", "0 1 2"),
            ("negative", "-99 1 2"),
            ("huge", "1 2 99999999999999999999"),
        ),
        *(("fraction", "1.5 2 3"), ("text", "a b c"), ("two", "1 2"), ("slashes", "1// //2 3//")),
    ):
        verdict = {"two": ANY, "slashes": NOT_GOOD}.get(name, REFUSED)
        files.add(
            f"indices/{name}.obj", encode(files.ball(), "obj").decode() + f"\nf {face}\nf 1 2 3\n", verdict
        )
    off = encode(files.ball(), "off").decode().rstrip().rsplit(" ", 1)[0]
    for index in ("42", "-1", "99999999999"):
        files.add(f"indices/{index}.off", f"{off} {index}\n")
    ply = encode(files.ball(), "ply")
    for index in (42, 10**6, 2**31 - 1, -1, -(2**31)):
        files.add(f"indices/{index}.ply", ply[:-4] + struct.pack("<i", index))
    for corners in (0, 1, 2, 4, 255):
        ply = encode(files.ball(), "ply")
        files.add(f"indices/corners{corners}.ply", ply[:-13] + bytes([corners]) + ply[-12:], ANY)
    glb = bytearray(encode(files.ball(), "glb"))
    start = 20 + struct.unpack_from("<I", glb, 12)[0] + 8
    for value in (255, 0xFFFF, 0xFFFFFFFF):
        struct.pack_into("<I", glb, start, value)
        files.add(f"indices/{value}.glb", bytes(glb))


def _archives(files: _Collection) -> None:
    inner = encode(files.ball(), "obj")
    bomb = b"v 0 0 0\n" * 5_000_000  # 40 MB in 40 kB
    for name, content in (("cup", inner), ("bomb", bomb)):
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("cup.obj", content)
            archive.writestr("../../escape.obj", b"v 0 0 0\n")
        for suffix in ("zip", "obj", "stl", "glb"):
            files.add(f"archives/{name}_zip.{suffix}", packed.getvalue())
        for suffix in ("obj.gz", "gz", "obj", "ply"):
            files.add(f"archives/{name}_gzip.{suffix}", gzip.compress(content))
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as archive:
        member = tarfile.TarInfo("../cup.obj")
        member.size = len(inner)
        archive.addfile(member, io.BytesIO(inner))
    for suffix in ("tar", "obj", "stl"):
        files.add(f"archives/tar.{suffix}", packed.getvalue())
    for magic, suffix in ((b"7z\xbc\xaf\x27\x1c", "7z"), (b"Rar!\x1a\x07", "rar"), (b"BZh9", "bz2")):
        files.add(f"archives/a.{suffix}", magic + bytes(100))
        files.add(f"archives/{suffix}.ply", magic + bytes(100))


def _noise(files: _Collection) -> None:
    rng = np.random.default_rng(20)
    for kind in (*FORMATS, "gltf"):
        for size in (1, 13, 84, 1000, 100_000):
            files.add(f"noise/{size}.{kind}", rng.bytes(size))
        files.add(f"noise/letters.{kind}", bytes(rng.integers(32, 127, 3000, dtype=np.uint8)))
    for name, magic in (
        ("glTF\2.glb", b"glTF\2\0\0\0"),
        ("ply.ply", b"ply\n"),
        ("solid.stl", b"solid "),
        ("OFF.off", b"OFF\n"),
    ):
        files.add(f"noise/magic_{name.replace(chr(2), '2')}", magic + rng.bytes(2000))
    for kind in (*FORMATS, "text.stl", "text.ply"):
        data = encode(files.ball(), kind)
        for number in range(3):
            damaged = bytearray(data)
            for place in rng.integers(0, min(len(data), 300), 6):
                damaged[place] = rng.integers(256)
            files.add(f"noise/damaged{number}.{kind}", bytes(damaged), ANY)


def _other_files(files: _Collection) -> None:
    contents = {
        "page": b"<!DOCTYPE html><html><body>404 Not Found</body></html>",
        "page_later": b"\n\n  <HTML><head></head></HTML>",
        "json": b'{"error": "rate limit exceeded"}',
        "xml": b'<?xml version="1.0"?><COLLADA/>',
        "picture": b"\x89PNG\r\n\x1a\n" + bytes(50),
        "photo": b"\xff\xd8\xff\xe0" + bytes(50),
        "document": b"%PDF-1.7\n" + bytes(50),
        "pointer": b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
        "blender": b"BLENDER-v293" + bytes(200),
    }
    for name, content in contents.items():
        for kind in ("stl", "obj", "ply", "glb"):
            files.add(f"other/{name}.{kind}", content)
    for suffix in ("blend", "fbx", "dae", "3mf", "step", "usdz"):
        files.add(f"other/model.{suffix}", b"whatever")


def _gltf_pair(mesh: trimesh.Trimesh) -> tuple[bytes, bytes]:
    """A glTF with one outside buffer, called buffer.bin."""
    exported = trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh), merge_buffers=True)
    (name,) = [name for name in exported if name.endswith(".bin")]
    return exported["model.gltf"].replace(name.encode(), b"buffer.bin"), exported[name]


def _gltf(files: _Collection) -> None:
    model, buffer = _gltf_pair(files.ball())
    (files.root / "gltf").mkdir()
    (files.root / "gltf/buffer.bin").write_bytes(buffer)
    files.verdicts["gltf/whole.gltf"] = GOOD
    (files.root / "gltf/whole.gltf").write_bytes(model)
    uris = {
        "parent": "../../../etc/passwd",
        "absolute": "/etc/passwd",
        "scheme": "file:///etc/passwd",
        "network": "http://127.0.0.1:9/none.bin",
        "missing": "none.bin",
        "folder": ".",
        "itself": "uri_itself.gltf",
        "device": "/dev/zero",
        "percent": "%2e%2e/%2e%2e/etc/passwd",
        "nul": "a\\u0000b",
        "base64": "data:application/octet-stream;base64,!!!!",
        "short": "data:application/octet-stream;base64," + base64.b64encode(b"abc").decode(),
    }
    for name, uri in uris.items():
        files.add(f"gltf/uri_{name}.gltf", model.replace(b"buffer.bin", uri.encode()))
    os.symlink("/dev/zero", files.root / "gltf/endless.bin")
    files.add("gltf/uri_endless.gltf", model.replace(b"buffer.bin", b"endless.bin"))

    def edited(name: str, change: object, verdict: str = REFUSED) -> None:
        own_model, own_buffer = _gltf_pair(files.ball())
        tree = json.loads(own_model)
        tree["buffers"][0]["uri"] = (
            "data:application/octet-stream;base64," + base64.b64encode(own_buffer).decode()
        )
        change(tree)  # type: ignore[operator]
        files.add(f"gltf/{name}.gltf", json.dumps(tree), verdict)

    for key in ("count", "bufferView", "componentType", "byteOffset"):
        for value in (-1, 10**9, 2**63, "x", None, 1.5):
            edited(
                f"accessor_{key}_{value}",
                lambda tree, k=key, v=value: tree["accessors"][0].update({k: v}),
                ANY,
            )
    for key in ("nodes", "meshes", "accessors", "bufferViews", "buffers", "scenes", "scene"):
        edited(f"without_{key}", lambda tree, k=key: tree.pop(k, None), ANY)
        edited(f"text_{key}", lambda tree, k=key: tree.update({k: "text"}), ANY)
    edited("cycle", lambda tree: tree.update(nodes=[{"children": [1]}, {"children": [0], "mesh": 0}]), ANY)
    edited("draco", lambda tree: tree.update(extensionsRequired=["KHR_draco_mesh_compression"]))
    edited("nan_matrix", lambda tree: tree["nodes"][-1].update(matrix=[float("nan")] * 16), ANY)
    edited("zero_matrix", lambda tree: tree["nodes"][-1].update(matrix=[0.0] * 16), ANY)
    deep = [{"children": [number + 1]} for number in range(3000)] + [{"mesh": 0}]
    edited("deep_nodes", lambda tree: tree.update(nodes=deep, scenes=[{"nodes": [0]}]), ANY)
    files.add("gltf/brackets.gltf", '{"asset":' + "[" * 100_000)


def _obj_text(files: _Collection) -> None:
    ball = encode(files.ball(), "obj").decode()
    grouped = encode(files.ball(), "obj").decode()
    files.add("obj/long_line.obj", "v " + "1 " * 2_000_000)
    files.add("obj/long_comment.obj", "#" * 5_000_000 + "\n" + encode(files.ball(), "obj").decode(), GOOD)
    files.add("obj/long_number.obj", f"v {'1' * 1_000_000} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    files.add("obj/polygon.obj", ball + "\nf " + " ".join(["1", "2", "3"] * 30_000) + "\n", ANY)
    files.add("obj/nul_bytes.obj", ball.replace("\nv", "\0\nv", 5), ANY)
    files.add("obj/backwards.obj", "f -3 -2 -1\nv 0 0 0\nv 1 0 0\nv 0 1 0\n")
    files.add("obj/latin1.obj", b"# caf\xe9 \xff\n" + encode(files.ball(), "obj"), GOOD)
    files.add("obj/byte_order_mark.obj", b"\xef\xbb\xbf" + encode(files.ball(), "obj"), ANY)
    files.add("obj/utf16.obj", encode(files.ball(), "obj").decode().encode("utf-16"), ANY)
    files.add("obj/carriage_returns.obj", encode(files.ball(), "obj").replace(b"\n", b"\r"), ANY)
    files.add("obj/crlf.obj", encode(files.ball(), "obj").replace(b"\n", b"\r\n"), GOOD)
    files.add(
        "obj/material_escape.obj", "mtllib ../../../etc/passwd\n" + encode(files.ball(), "obj").decode(), GOOD
    )
    files.add(
        "obj/shell.obj", "csh rm -rf nothing\ncall other.obj\n" + encode(files.ball(), "obj").decode(), GOOD
    )
    files.add("obj/many_groups.obj", "".join(f"g part{n}\no o{n}\n" for n in range(20_000)) + grouped, ANY)


def _ply_text(files: _Collection) -> None:
    start = "ply\nformat ascii 1.0\n"
    three = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    face = "element face 1\nproperty list uchar int vertex_indices\n"
    rows = "0 0 0\n1 0 0\n0 1 0\n"
    texts = {
        "no_end": start + three + face,
        "no_format": "ply\n" + three + face + "end_header\n" + rows + "3 0 1 2\n",
        "unknown_format": "ply\nformat morse 1.0\n" + three + face + "end_header\n" + rows,
        "unknown_type": start + three.replace("float", "quad") + face + "end_header\n" + rows + "3 0 1 2\n",
        "no_x": start + three.replace(" x", " a") + face + "end_header\n" + rows + "3 0 1 2\n",
        "many_properties": start + "element vertex 1\n" + "property float p\n" * 20_000 + "end_header\n",
        "many_elements": start + "element thing 1000000000\nproperty float a\n" * 500 + "end_header\n",
        "list_bomb": start + three + face + "end_header\n" + rows + "2000000000 0 1 2\n",
        "negative_list": start + three + face + "end_header\n" + rows + "-3 0 1 2\n",
        "words": start + three + face + "end_header\n" + "a b c\n" * 3 + "3 0 1 2\n",
        "long_comment": start + "comment " + "x" * 3_000_000 + "\n",
        "texture_escape": start + "comment TextureFile ../../../etc/passwd\n" + three + "end_header\n" + rows,
    }
    for name, text in texts.items():
        files.add(f"ply/{name}.ply", text)


def _stl_text(files: _Collection) -> None:
    good = encode(files.ball(), "text.stl").decode()
    texts = {
        "no_end": good.replace("endsolid", ""),
        "two_corners": good.replace("vertex", "", 1),
        "words": good.replace("vertex 0", "vertex zero"),
        "unclosed_facet": good.replace("endfacet", "", 1) + "facet normal",
        "only_end": "solid x\n" + "endfacet\n" * 1000 + "endsolid\n",
        "long_line": "solid " + "x" * 3_000_000 + "\nendsolid\n",
        "binary_tail": good + "\0" * 500,
        "nested": "solid a\n" * 5000 + "endsolid\n" * 5000,
    }
    for name, text in texts.items():
        files.add(f"stl/{name}.stl", text, ANY if name in ("words", "binary_tail") else REFUSED)


def _off_text(files: _Collection) -> None:
    for name, text in {
        "only_magic": "OFF\n",
        "no_counts": "OFF\n# nothing\n\n",
        "one_count": "OFF\n3\n",
        "words": "OFF\nthree one zero\n",
        "no_magic": "3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "short_rows": "OFF\n3 1 0\n0 0\n1 0\n0 1\n3 0 1 2\n",
        "polygon_count": "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n9999999 0 1 2\n",
    }.items():
        files.add(f"off/{name}.off", text, REFUSED)


def _file_system(files: _Collection, outside: Path) -> None:
    place = files.root / "places"
    place.mkdir()
    verdicts = files.verdicts
    (place / "folder.stl").mkdir()
    os.mkfifo(place / "pipe.stl")
    os.symlink("loop_b.stl", place / "loop_a.stl")
    os.symlink("loop_a.stl", place / "loop_b.stl")
    os.symlink("nowhere.stl", place / "broken.stl")
    os.symlink(outside, place / "outside.stl")
    os.symlink(outside.parent, place / "outside_folder")
    os.symlink("/dev/zero", place / "device.stl")
    for name in ("folder", "pipe", "loop_a", "loop_b", "broken", "outside", "device"):
        verdicts[f"places/{name}.stl"] = REFUSED
    verdicts["places/outside_folder"] = REFUSED
    os.symlink(".", place / "circle")  # leads back to a folder that is listed anyway
    server = socket.socket(socket.AF_UNIX)
    before = Path.cwd()
    os.chdir(place)  # the name of a socket must be short
    server.bind("socket.stl")
    os.chdir(before)
    server.close()
    verdicts["places/socket.stl"] = REFUSED
    with (place / "sparse.stl").open("wb") as file:
        file.truncate(3_000_000_000)
    verdicts["places/sparse.stl"] = REFUSED
    for name in (b"two\nlines.stl", b"bell\x07.stl", b"caf\xe9.stl"):
        with open(os.fsencode(place) + b"/" + name, "wb") as file:
            file.write(encode(files.ball(), "stl"))
    for name in ("two\\nlines.stl", "bell\\x07.stl", "caf\\udce9.stl"):
        verdicts[f"places/{name}"] = REFUSED
    secret = place / "unreadable.stl"
    secret.write_bytes(encode(files.ball(), "stl"))
    secret.chmod(0)
    verdicts["places/unreadable.stl"] = GOOD if os.access(secret, os.R_OK) else REFUSED
    _deep_folders(place / "deep", verdicts)


def _deep_folders(folder: Path, verdicts: dict[str, str]) -> None:
    """Folders in folders, deeper than any path can say."""
    before = Path.cwd()
    folder.mkdir()
    os.chdir(folder)
    try:
        for _ in range(50):
            os.mkdir("d" * 100)
            os.chdir("d" * 100)
    finally:
        os.chdir(before)
    verdicts["places/deep/**"] = REFUSED
