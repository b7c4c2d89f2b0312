"""A disk that is really full, and one that is really read-only: a small file system in a namespace of its own."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

from factory_support import digests, made_dataset

PROGRAM = """
import json, os, subprocess, sys
from pathlib import Path

from factory_support import digests, new_dataset
from waveformer.datagen.dataset_audit import audit
from waveformer.datagen.dataset_reader import open_dataset
from waveformer.datagen.factory_run import run_factory
from waveformer.simulator.errors import StoreError

disk = Path(sys.argv[1])

def mount(options):
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(disk)], check=True)

def attempt(action):
    try:
        action()
        return "done"
    except StoreError as error:
        return str(error)

def balance():
    found = audit(disk / "store")
    return [found.committed, found.quarantined, found.pending, len(found.damaged)]

if __name__ == "__main__":
    rows = {}
    mount("size=4m")
    new_dataset(disk / "store")
    for left in (4096, 8192, 16384, 32768):  # bytes, so that the disk fills up at different places
        system = os.statvfs(disk)
        used = (system.f_blocks - system.f_bfree) * system.f_frsize
        mount(f"remount,size={used + left}")
        rows[f"full {left}"] = [attempt(lambda: run_factory(disk / "store")), balance()]
    mount("remount,size=4m")
    mount("remount,ro")
    rows["read-only"] = [attempt(lambda: run_factory(disk / "store")), balance()]
    rows["read"] = open_dataset(disk / "store").indices.tolist()
    mount("remount,rw")
    rows["resumed"] = [attempt(lambda: run_factory(disk / "store")), balance()]
    print(json.dumps({"rows": rows, "digests": digests(disk / "store")}))
"""


def may_mount():
    if shutil.which("unshare") is None:
        return False
    command = ["unshare", "-rm", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not may_mount(), reason="needs file systems of its own: unshare -rm and mount")
def test_full_and_read_only_disks_lose_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
    undisturbed = made_dataset(tmp_path / "undisturbed")
    (tmp_path / "disk").mkdir()
    (tmp_path / "program.py").write_text(PROGRAM)
    command = ["unshare", "-rm", sys.executable, str(tmp_path / "program.py"), str(tmp_path / "disk")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    rows = found["rows"]
    with capsys.disabled():
        for name, row in rows.items():
            print(f"\n{name}: {row}", end="")
        print()
    committed = 0
    for name in ("full 4096", "full 8192", "full 16384", "full 32768"):
        message, balance = rows[name]
        assert "No space left on device" in message and "\n" not in message
        assert balance[0] >= committed and sum(balance[:3]) == 14 and balance[3] == 0
        committed = balance[0]
    message, balance = rows["read-only"]
    assert "Read-only file system" in message and balance == [committed, 0, 14 - committed, 0]
    assert rows["read"] == list(range(committed))
    assert rows["resumed"] == ["done", [14, 0, 0, 0]]
    assert found["digests"] == digests(undisturbed)
