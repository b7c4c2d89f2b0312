"""Stores appear complete or not at all, and only stores of the same kind are ever replaced."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from waveformer.simulator.errors import StoreError
from waveformer.simulator.storage import check_writable, publish, publish_file, store_format
from waveformer.simulator.zarr_store import StoredArray, read_store, write_store

FORMAT = "waveformer.test"


def write(path: Path, value: float = 1.0, *, overwrite: bool = False, format_name: str = FORMAT) -> None:
    arrays = {"a": StoredArray(np.full((4, 3), value), ("row", "column"), (2, 3))}
    write_store(path, format_name, 1, arrays, {"note": "text"}, overwrite=overwrite)


def read(path: Path) -> float:
    return float(read_store(path, FORMAT, 1)[0]["a"].mean())


def leftovers(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir() if p.name.startswith("."))


def test_write_then_read(tmp_path):
    write(tmp_path / "deep" / "s.zarr", 2.5)
    arrays, attributes = read_store(tmp_path / "deep" / "s.zarr", FORMAT, 1)
    np.testing.assert_array_equal(arrays["a"], np.full((4, 3), 2.5))
    assert attributes["note"] == "text"
    assert leftovers(tmp_path / "deep") == []


@pytest.mark.parametrize("interruption", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_interrupted_writing_leaves_nothing(tmp_path, interruption):
    with pytest.raises(interruption), publish(tmp_path / "s.zarr") as folder:
        (folder / "zarr.json").write_text("half")
        raise interruption
    assert list(tmp_path.iterdir()) == []


def test_interrupted_overwriting_keeps_the_old_store(tmp_path):
    write(tmp_path / "s.zarr", 1.0)
    with pytest.raises(KeyboardInterrupt), publish(tmp_path / "s.zarr", overwrite=True):
        raise KeyboardInterrupt
    assert read(tmp_path / "s.zarr") == 1.0
    assert leftovers(tmp_path) == []


CHILD = """
import signal, sys, time
from waveformer.simulator.storage import publish
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job inherits it ignored
with publish(sys.argv[1]) as folder:
    (folder / "zarr.json").write_text('{"attributes": {}}')
    print("inside", flush=True)
    time.sleep(60)
"""


@pytest.mark.parametrize(
    ("number", "exit_code", "leaves_temporary"),
    [(signal.SIGKILL, -9, True), (signal.SIGTERM, 143, False), (signal.SIGINT, -2, False)],
)
def test_killed_process_leaves_no_store(tmp_path, number, exit_code, leaves_temporary):
    target = tmp_path / "s.zarr"
    child = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(CHILD), str(target)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "inside\n"
    child.send_signal(number)
    assert child.wait(20) == exit_code
    assert not target.exists()
    assert bool(leftovers(tmp_path)) == leaves_temporary
    for name in leftovers(tmp_path):  # what kill -9 leaves behind is never taken for a store
        assert store_format(tmp_path / name) is None
    write(target)  # and it is in nobody's way
    assert read(target) == 1.0


def test_existing_store_needs_force(tmp_path):
    write(tmp_path / "s.zarr", 1.0)
    with pytest.raises(StoreError, match=r"s\.zarr exists; pass --force \(overwrite=True\)"):
        write(tmp_path / "s.zarr", 2.0)
    assert read(tmp_path / "s.zarr") == 1.0
    write(tmp_path / "s.zarr", 2.0, overwrite=True)
    assert read(tmp_path / "s.zarr") == 2.0
    assert leftovers(tmp_path) == []


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("kind", ["folder", "empty folder", "file", "foreign zarr", "dangling link"])
def test_foreign_data_are_never_replaced(tmp_path, kind, overwrite):
    target = tmp_path / "data"
    if kind == "file":
        target.write_text("precious")
    elif kind == "dangling link":
        target.symlink_to(tmp_path / "nowhere")
    else:
        target.mkdir()
        if kind == "folder":
            (target / "thesis.tex").write_text("precious")
        if kind == "foreign zarr":
            (target / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group", "attributes": {}}')
    with pytest.raises(StoreError, match="choose another path"):
        write(target, overwrite=overwrite)
    assert os.path.lexists(target)


def test_store_of_another_kind_is_never_replaced(tmp_path):
    write(tmp_path / "scan.zarr", format_name="waveformer.measurement")
    with pytest.raises(StoreError, match=r"holds a waveformer\.measurement"):
        write(tmp_path / "scan.zarr", overwrite=True)


def test_link_to_a_store_is_followed(tmp_path):
    write(tmp_path / "real.zarr", 1.0)
    (tmp_path / "link.zarr").symlink_to(tmp_path / "real.zarr")
    write(tmp_path / "link.zarr", 3.0, overwrite=True)
    assert (tmp_path / "link.zarr").is_symlink()
    assert read(tmp_path / "real.zarr") == 3.0


def test_unwritable_places_are_refused_up_front(tmp_path):
    # Under a file and under /proc, because root may write everywhere else.
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "s.zarr", Path("/proc/s.zarr"), Path("/")):
        with pytest.raises(StoreError):
            check_writable(path)


@pytest.mark.parametrize("writer", [publish, publish_file])
def test_full_disk_is_one_line(tmp_path, writer):
    with (
        pytest.raises(StoreError, match=r"cannot write .*s\.zarr: No space left"),
        writer(tmp_path / "s.zarr"),
    ):
        raise OSError(28, "No space left on device")
    assert list(tmp_path.iterdir()) == []


def test_published_file_keeps_the_old_one_on_failure(tmp_path):
    target = tmp_path / "picture.png"
    with publish_file(target) as temporary:
        assert temporary.suffix == ".png"
        temporary.write_bytes(b"old")
    with pytest.raises(StoreError, match="--force"), publish_file(target):
        pass
    with pytest.raises(KeyboardInterrupt), publish_file(target, overwrite=True) as temporary:
        temporary.write_bytes(b"new")
        raise KeyboardInterrupt
    assert target.read_bytes() == b"old"
    assert leftovers(tmp_path) == []
