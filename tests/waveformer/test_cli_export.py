"""`waveformer export` as a user runs it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import h5py
import pytest
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.datagen.export_dca1000 import read_dca1000

sys.path.append(str(Path(__file__).parents[1] / "datagen"))
import reading_makers as makers


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return makers.make(tmp_path_factory.mktemp("export") / "store", 10)


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["export", *(str(argument) for argument in arguments)])
    assert result.exit_code == code, result.output
    return result


@pytest.mark.parametrize("name", ["npz", "webdataset", "dca1000", "hdf5"])
def test_formats(store, tmp_path, name):
    out = tmp_path / "out"
    result = run(store, "--format", name, "--out", out, "--limit", 3, "--json")
    summary = json.loads(result.stdout)
    assert summary["samples"] == 3
    files = [out] if out.is_file() else [path for path in out.rglob("*") if path.is_file()]
    assert summary["bytes"] == sum(path.stat().st_size for path in files)
    assert "2 samples are quarantined" in result.stderr
    again = run(store, "--format", name, "--out", out, "--limit", 3, code=1)
    assert "--force" in again.stderr
    assert "3 samples" in run(store, "--format", name, "--out", out, "--limit", 3, "--force").stdout


def test_choice(store, tmp_path):
    out = tmp_path / "out.h5"
    arrays = ["--arrays", "truth_m", "--arrays", "partial_m"]
    run(store, "--format", "hdf5", "--out", out, "--split", "evaluation", *arrays)
    with h5py.File(out) as file:
        assert file["sample_index"][:].tolist() == [4, 5]
        assert set(file) == {"sample_index", "record", "truth_m", "partial_m"}


def test_device(store, tmp_path):
    run(store, "--format", "dca1000", "--out", tmp_path / "out", "--device", "xwr14xx")
    assert read_dca1000(tmp_path / "out/samples/00000000.bin").shape == (12, 8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--format", "npz", "--device", "xwr14xx"], "--device belongs to"),
        (["--format", "dca1000", "--arrays", "truth_m"], "signals only"),
        (["--format", "dca1000", "--device", "awr"], "unknown device 'awr'"),
        (["--format", "npz", "--arrays", "truth"], "no array 'truth'"),
        (["--format", "npz", "--split", "test"], "no sample with split 'test'"),
    ],
)
def test_one_line_errors(store, tmp_path, arguments, message):
    result = run(store, "--out", tmp_path / "out", *arguments, code=1)
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_no_dataset(tmp_path):
    assert "no dataset" in run(tmp_path, "--format", "npz", "--out", tmp_path / "out", code=1).stderr
