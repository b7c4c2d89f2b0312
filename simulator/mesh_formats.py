"""What distinguishes mesh file formats and what trimesh misses in each of them.

trimesh cuts short text files without a word, answers a truncated binary STL with an empty scene and unpacks
archives without a limit. Every format is therefore checked before it is parsed, and its number of faces
after.
"""

from __future__ import annotations

import json
import re
from typing import Any

from waveformer.simulator.errors import MeshError

MESH_FORMATS = ("glb", "gltf", "obj", "off", "ply", "stl")
ARCHIVE_FORMATS = ("zip", "gz", "tgz", "tar", "bz2", "xz", "7z", "rar", "zst", "zae")
_ARCHIVE_MAGIC = (
    b"PK\x03\x04",
    b"\x1f\x8b",
    b"BZh",
    b"\xfd7zXZ",
    b"7z\xbc\xaf",
    b"Rar!",
    b"\x28\xb5\x2f\xfd",
)
_OTHER_MAGIC = {
    b"BLENDER": "a Blender project; open it in Blender and export a mesh",
    b"Kaydara FBX": "an FBX file; convert it to glb, obj, ply or stl",
    b"%PDF": "a PDF document; get the file again",
    b"\x89PNG": "a picture; get the file again",
    b"\xff\xd8\xff": "a picture; get the file again",
    b"version https://git-lfs": "a Git LFS pointer; fetch the file itself (git lfs pull)",
}
_LENGTH_WORDS = (
    *("cannot reshape", "to unpack", "could not be read to its end", "buffer is smaller", "inhomogeneous"),
    "setting an array element",
)
_CODE_WORDS = (
    "indices must be",
    "object has no",
    "null byte",
    "operand",
    "argument",
    "dtype",
    "index-sized",
    "`",
    "axis",
)
_STL_HEADER_BYTES, _STL_TRIANGLE_BYTES = 84, 50
GET_AGAIN = "get or export the file again"


def sniff_format(name: str, suffix: str, data: bytes) -> str:
    """The format by content where it has a signature (downloads are often misnamed), else by suffix."""
    if suffix in ARCHIVE_FORMATS or (suffix in MESH_FORMATS and _is_archive(data)):
        raise MeshError(
            "mesh.archive", f"{name}: archives are not opened; unpack it and name the mesh file inside"
        )
    if suffix not in MESH_FORMATS:
        raise MeshError(
            "mesh.unreadable",
            f"{name}: unknown mesh format {'.' + suffix if suffix else '(no file extension)'}; "
            f"supported: {', '.join(MESH_FORMATS)}",
        )
    if not data.strip():
        raise MeshError("mesh.empty", f"{name}: the file is empty; {GET_AGAIN}")
    start = data[:512].lstrip().lower()
    if start.startswith((b"<!doctype html", b"<html")):
        raise MeshError(
            "mesh.unreadable", f"{name}: a web page, not a mesh (a failed download?); {GET_AGAIN}"
        )
    for magic, what in _OTHER_MAGIC.items():
        if data.startswith(magic):
            raise MeshError("mesh.unreadable", f"{name}: not a mesh but {what}")
    if data.startswith(b"glTF"):
        return "glb"
    if data.startswith((b"ply\n", b"ply\r")):
        return "ply"
    return suffix


def _is_archive(data: bytes) -> bool:
    return data.startswith(_ARCHIVE_MAGIC) or data[257:262] == b"ustar"


def check_before(file_format: str, name: str, data: bytes) -> None:
    """Refuses what trimesh would read wrongly.

    Raises:
        MeshError: the file is truncated, compressed or out of range.
    """
    checks = {"stl": _check_stl, "obj": _check_obj, "glb": _check_gltf, "gltf": _check_gltf}
    if file_format in checks:
        checks[file_format](name, data)


def _check_stl(name: str, data: bytes) -> None:
    """A binary STL has exactly the promised length; a text STL closes what it opens."""
    if _is_text(data):
        if data.lstrip()[:5].lower() != b"solid":
            raise MeshError("mesh.unreadable", f"{name}: neither a text nor a binary STL; {GET_AGAIN}")
        if b"endsolid" not in data[-4096:].lower():
            raise truncated(name, "the closing endsolid is missing")
        return
    promised = int.from_bytes(data[80:84], "little") if len(data) >= _STL_HEADER_BYTES else 1
    expected_bytes = _STL_HEADER_BYTES + promised * _STL_TRIANGLE_BYTES
    if len(data) < expected_bytes:
        raise truncated(
            name, f"a binary STL of {promised} triangles has {expected_bytes} bytes, this has {len(data)}"
        )
    if len(data) > expected_bytes:
        raise MeshError(
            "mesh.unreadable",
            f"{name}: {len(data) - expected_bytes} bytes more than its {promised} triangles need; "
            f"{GET_AGAIN}",
        )


def _check_obj(name: str, data: bytes) -> None:
    """Refuses a cut last line, vertex 0, and relative numbers between vertices: trimesh misreads them."""
    last = data.rstrip().rsplit(b"\n", 1)[-1].split()
    if last[0] in (b"v", b"f") and len(last) < 4:
        raise truncated(name, "its last line is incomplete")
    if re.search(rb"^f\s(?:[^\n]*\s)?0(?:[/\s]|$)", data, re.MULTILINE):
        raise index_range(name, "a face names vertex 0, and OBJ counts from 1")
    relative = re.search(rb"^f\s+-", data, re.MULTILINE)
    if relative and data.find(b"\nv ", relative.start()) >= 0:
        raise MeshError(
            "mesh.unreadable",
            f"{name}: its faces count vertices backwards; export it with absolute vertex numbers",
        )


def _check_gltf(name: str, data: bytes) -> None:
    """A GLB is as long as it says; geometry compressed by an extension would come out as zeros."""
    text = data
    if data.startswith(b"glTF"):
        promised_bytes = int.from_bytes(data[8:12], "little")
        if not 20 <= promised_bytes <= len(data):
            raise truncated(name, f"it has {len(data)} bytes and should have {max(promised_bytes, 20)}")
        text = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    try:
        required = json.loads(text).get("extensionsRequired", [])
        compressed = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}.intersection(required)
    except (ValueError, AttributeError, TypeError, RecursionError) as error:
        raise truncated(name, "its JSON header is not complete") from error
    if compressed:
        raise MeshError(
            "mesh.unreadable",
            f"{name}: compressed geometry ({min(compressed)}); export it without compression",
        )


def promised_faces(file_format: str, data: bytes) -> int:
    """Faces that a text file declares; trimesh stops early without a word when there are fewer lines."""
    if file_format == "stl" and _is_text(data):
        return len(re.findall(rb"facet\s+normal", data, re.IGNORECASE))
    if file_format == "off":
        lines = (line.split(b"#")[0].split() for line in data.split(b"OFF", 1)[-1].splitlines())
        counts = next(line for line in lines if line)
        return int(counts[1])
    if file_format == "ply":
        declared = re.search(rb"^element\s+face\s+(\d+)", data[: data.find(b"end_header")], re.MULTILINE)
        return int(declared[1]) if declared else 0
    return 0


def _is_text(data: bytes) -> bool:
    """True unless there are zero bytes near the start, as in the triangle count of every binary STL."""
    return b"\0" not in data[:1024]


def plain_reason(error: BaseException) -> str:
    """What a parser's exception means to somebody who knows meshes but not the parser."""
    text = one_line(error)
    if isinstance(error, UnicodeDecodeError):
        return "bytes that are not text, where the format wants text"
    if "escapes resolver root" in text:
        return "it names a file outside of its own folder, which is never read"
    if isinstance(error, OSError):
        return "another file that it needs cannot be read"
    if number := re.search(r"(?:invalid literal for int|could not convert string to float).*: (.+)", text):
        return f"{number[1][:40]} stands where a number must"
    if any(words in text for words in _LENGTH_WORDS):
        return "there is less or more data than it declares"
    # Only the parser's own words are for people; the rest speaks of its variables.
    if not isinstance(error, (ValueError, NotImplementedError)) or any(
        words in text for words in _CODE_WORDS
    ):
        return "its content does not follow the format"
    return text or "its content does not follow the format"


def truncated(name: str, reason: str) -> MeshError:
    """The error for a file that ends too early."""
    return MeshError("mesh.truncated", f"{name}: cut off or damaged ({reason}); {GET_AGAIN}")


def index_range(name: str, reason: str) -> MeshError:
    """The error for a face that points outside the vertices."""
    return MeshError("mesh.index_range", f"{name}: a face index is out of range ({reason}); {GET_AGAIN}")


def one_line(text: Any) -> str:
    """At most 200 printable characters of a text, on one line."""
    return re.sub(r"[^ -~\u00a0-\uffff]+", " ", str(text)).strip()[:200]
