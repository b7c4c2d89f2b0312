"""Every example of docs/datasets.md on reading and exporting runs as printed."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

sys.path.append(str(Path(__file__).parent))
import reading_makers as makers

PAGE = (Path(__file__).parents[2] / "docs" / "datasets.md").read_text(encoding="utf-8")
READING, EXPORT = PAGE[PAGE.index("## Read a dataset") :].split("\n## Export")


def blocks(language, text):
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A working directory with a dataset."""
    folder = tmp_path_factory.mktemp("page")
    makers.make(folder / "dataset", 10)
    return folder


def run(arguments, folder):
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr.strip(), done.stderr
    return done.stdout


@pytest.mark.parametrize("number", range(3))
def test_reading(folder, number):
    script = folder / "script.py"
    found = blocks("python", READING)
    assert len(found) == 3
    script.write_text(found[number])
    output = run([script.name], folder)
    expected = [
        "8 samples, 2 quarantined, 0 pending\ntest/0 (10, 3) (30, 3)\n",
        "]]\n",
        "torch.Size([2, 2, 10, 3]) torch.Size([2, 30, 3]) 1\n",
    ]
    assert output.endswith(expected[number])


def test_export(folder):
    (commands,) = blocks("sh", EXPORT)
    for line in commands.splitlines():
        program, *arguments = shlex.split(line)
        assert program == "waveformer"
        done = subprocess.run(
            [sys.executable, "-m", "waveformer", *arguments], cwd=folder, capture_output=True, check=False
        )
        assert done.returncode == 0, done.stderr
    with h5py.File(folder / "exported.h5") as file:
        assert file["sample_index"][:].tolist() == [0, 1, 2, 6, 7, 9]
    (code,) = blocks("python", EXPORT)
    output = run(["-c", code], folder)
    assert output == "00000000.bin (12, 8)\n00000001.bin (12, 8)\n"
