"""Hundreds of hostile files among good ones: each is told off in one plain line, and none does harm."""

from __future__ import annotations

import re
import resource
import runpy
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest

from waveformer.datagen.catalog_scan import scan_catalog

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # trimesh, while it writes NaN

MEMORY_LIMIT_BYTES = 1_500_000_000
# What a parser says to its programmer, not to the owner of the file.
CODE = re.compile(
    r"Traceback|Error\b|Exception|0x[0-9a-f]{6}|<class|object has no|NoneType|operand|indices must|to unpack|reshape"
    r"|dtype|index-sized|invalid literal|not associated|\(None\)|\[Errno|allow_anywhere|b'|\\x(?!07)"
)
ACCEPTED = {
    "good": {"good"},
    "repaired": {"repaired"},
    "refused": {"refused"},
    "not good": {"repaired", "refused"},
    "any": {"good", "repaired", "refused"},
}


@pytest.fixture(scope="module")
def scanned(tmp_path_factory):
    """The verdict wanted for each path, the catalogue, and how long the slowest file took, in seconds."""
    folder = tmp_path_factory.mktemp("hostile")
    outside = folder / "outside/secret.stl"
    outside.parent.mkdir()
    outside.write_bytes(b"solid secret\nendsolid secret\n")
    root = folder / "root"
    root.mkdir()
    write = runpy.run_path(str(Path(__file__).with_name("hostile_meshes.py")))["write_hostile_files"]
    wanted = write(root, outside)
    times = [time.perf_counter()]
    catalog = scan_catalog(
        root,
        "folder",
        unit_m=1.0,
        memory_limit_bytes=MEMORY_LIMIT_BYTES,
        progress=lambda done, total: times.append(time.perf_counter()),
    )
    yield wanted, catalog, max(after - before for before, after in pairwise(times))
    (root / "places/unreadable.stl").chmod(0o600)


REASONS = {
    r"cut/.*\.(stl|glb)": "cut off or damaged|the file is empty|holds no geometry",
    r"headers/stl_\d+\.stl": "bytes more than its|a binary STL of",
    r"nonfinite/-?(nan|inf)\..*": "vertices are not finite",
    r"sizes/millimetres\..*": "is it in mm",
    r"sizes/(huge|overflow)\..*": "is more than 5 m",
    r"sizes/(needle|stray_vertex)\..*": "a needle",
    r"sizes/plate\..*": "flat",
    r"nothing/(empty|blank)\..*": "the file is empty",
    r"nothing/points\..*": "a point cloud",
    r"nothing/(one_point|line)\..*": "every face has zero area",
    r"indices/(high|zero|negative|huge)\.obj": "a face index is out of range",
    r"indices/[-\d]+\.ply": "a face index is out of range",
    r"archives/.*": "archives are not opened",
    r"other/page.*": "a web page",
    r"other/blender.*": "a Blender project",
    r"gltf/uri_(parent|absolute|device|endless)\.gltf": "a file outside of its own folder",
    r"places/(pipe|socket)\.stl": "not a regular file",
    r"places/loop.*": "leads in a circle",
    r"places/(outside|device).*": "leads out of the catalogue's folder",
    r"places/sparse\.stl": "more than the limit of 2 GB",
}


def verdict(entry):
    return "refused" if entry.reason else "repaired" if entry.problems else "good"


def test_every_file_gets_the_verdict_it_should(scanned, capsys):
    wanted, catalog, _ = scanned
    found = {entry.path: entry for entry in catalog.entries}
    groups = {path[:-2]: want for path, want in wanted.items() if path.endswith("**")}
    for prefix, want in groups.items():
        below = [found.pop(path) for path in list(found) if path.startswith(prefix)]
        assert below
        assert {verdict(entry) for entry in below} <= ACCEPTED[want]
    single = {path: want for path, want in wanted.items() if not path.endswith("**")}
    assert found.keys() == single.keys()
    wrong = {
        path: (want, verdict(found[path]), found[path].reason)
        for path, want in single.items()
        if verdict(found[path]) not in ACCEPTED[want]
    }
    assert wrong == {}
    hostile = [entry for entry in found.values() if single[entry.path] != "good"]
    assert len(hostile) >= 300
    with capsys.disabled():
        counts = Counter(verdict(entry) for entry in hostile)
        print(
            f"\nhostile files: {len(hostile)}; {dict(counts)}; beside them good: {len(found) - len(hostile)}"
        )


def test_reasons_are_one_plain_line(scanned):
    _, catalog, _ = scanned
    for entry in catalog.entries:
        for line in (entry.reason, *entry.problems):
            assert "\n" not in line
            assert line.isprintable()
            assert not CODE.search(line), f"{entry.path}: {line}"
            assert len(line) < 400
            assert str(catalog.root.parent) not in line


@pytest.mark.parametrize(("paths", "words"), REASONS.items())
def test_the_reason_is_the_right_one(scanned, paths, words):
    _, catalog, _ = scanned
    reasons = {entry.path: entry.reason for entry in catalog.entries if re.fullmatch(paths, entry.path)}
    assert reasons
    assert {path: reason for path, reason in reasons.items() if not re.search(words, reason)} == {}


def test_none_takes_long_and_none_much_memory(scanned):
    _, _, slowest_s = scanned
    assert slowest_s < 60
    # Of all children of this process so far, the scan's among them; the limit holds the address space.
    peak_bytes = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    assert peak_bytes < 2 * 2**30


def test_nothing_outside_was_read(scanned):
    wanted, catalog, _ = scanned
    outside = {path for path in wanted if "outside" in path or "uri_" in path or "escape" in path}
    for entry in catalog.entries:
        if entry.path in outside and wanted[entry.path] == "refused":
            assert entry.geometry_sha256 == entry.sha256 == ""
