"""A lock lives as long as its process, not as long as its file."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from waveformer.simulator.errors import StoreError
from waveformer.simulator.file_lock import FileLock

CHILD = """
import sys, time
from pathlib import Path
from waveformer.simulator.file_lock import FileLock
lock = FileLock(Path(sys.argv[1]))
print("locked", flush=True)
time.sleep(60)
"""


def test_a_killed_process_leaves_no_lock(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "lock"
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "locked\n"
    with pytest.raises(StoreError, match=f"in use by process {child.pid}"):
        FileLock(path)
    child.send_signal(signal.SIGKILL)
    child.wait(20)
    assert path.exists()
    lock = FileLock(path)
    assert path.read_text() == f"{os.getpid()}\n"
    lock.release()
    lock.release()


def test_a_removed_lock_file_does_not_let_two_in(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "lock"
    first = FileLock(path)
    shutil.rmtree(path.parent)
    first.release()
    second = FileLock(path)
    with pytest.raises(StoreError, match="in use"):
        FileLock(path)
    second.release()


def test_a_full_disk_leaves_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "write", full)
        with pytest.raises(OSError, match="No space left"):
            FileLock(tmp_path / "lock")
    FileLock(tmp_path / "lock").release()
