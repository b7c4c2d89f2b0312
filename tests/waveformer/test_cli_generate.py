"""`waveformer generate`, `propose` and `dataset` as a user runs them, on tiny apertures."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.datagen.dataset_reader import open_dataset

CONFIG = """
views = 1
truth_points = 1024
[objects]
procedural = 4
[aperture]
num_x = 30
num_y = 30
[signal]
[signal.front_end]
mirror_snr_db = [60.0, 60.0]
[signal.occluder]
sheet_share = 0.0
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "tiny.toml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WAVEFORMER_DEBUG", raising=False)
    return tmp_path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert code is None or result.exit_code == code, result.output
    return result


def test_from_nothing_to_candidates(folder):
    made = run("generate", "tiny.toml", "--out", "store")
    assert "4 requested = 4 committed + 0 quarantined + 0 pending; 4 made now" in made.stdout
    again = json.loads(run("generate", "tiny.toml", "--out", "store", "--json").stdout)
    assert (again["committed"], again["written"], again["objects"]) == (4, 0, 4)
    for name in ("README.md", "card.json", "samples.png"):
        assert (folder / "store" / name).stat().st_size > 100
    assert "4 requested = 4 committed" in run("dataset", "info", "store").stdout
    assert "all intact" in run("dataset", "verify", "store").stdout
    run("dataset", "show", "store", "--out", "sheet.png", "--count", 2)

    proposed = run("propose", "store", "--out", "candidates", "--json", code=None).stdout
    summary = json.loads(proposed)
    assert summary["committed"] + summary["quarantined"] == 4 and summary["committed"] >= 1
    data = open_dataset("candidates")
    sample = data.read(data.indices[0])
    count = int((sample["candidate_count"] > 0).sum())
    assert count > 3 and (np.diff(sample["candidate_loss"][:count]) >= 0).all()
    assert sample["candidate_error_m"][sample["best"]] == np.nanmin(sample["candidate_error_m"])


def test_damage_is_told_with_the_exit_code_and_mended(folder):
    run("generate", "tiny.toml", "--out", "store", "--partials-only")
    before = open_dataset("store").read(2)["truth_m"]
    path = folder / "store/samples.zarr/truth_m/c/0/0/0"
    content = bytearray(path.read_bytes())
    content[1000] ^= 1
    path.write_bytes(content)
    result = run("dataset", "verify", "store", code=1)
    assert "1 damaged files" in result.stdout and "truth_m" in result.stderr
    run("dataset", "gc", "--damaged", "store")
    run("generate", "tiny.toml", "--out", "store", "--partials-only")
    assert "all intact" in run("dataset", "verify", "store").stdout
    np.testing.assert_array_equal(open_dataset("store").read(2)["truth_m"], before)


def test_other_settings_are_refused_in_one_line(folder):
    run("generate", "tiny.toml", "--out", "store", "--partials-only")
    result = run("generate", "tiny.toml", "--out", "store", "--partials-only", "--seed", 1, code=1)
    assert "other settings (settings.seed: 0, not 1)" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--out", "s"), "objects"),
        (("--out", "s", "--procedural", 2, "--meshes", "m"), "needs one of"),
        (("tiny.toml", "--out", "s", "--views", 0), "views"),
        (("missing.toml", "--out", "s"), "no such configuration"),
        (("--out", "s", "--catalog", "missing.parquet"), "missing.parquet"),
        (("tiny.toml", "--out", "tiny.toml"), "tiny.toml"),
        (("tiny.toml", "--out", "s", "--shard-index", 3), "shard-index"),
    ],
)
def test_bad_requests_are_one_line(folder, arguments, message):
    result = run("generate", *arguments, code=1)
    assert (
        message in result.stderr and result.stderr.startswith("error:") and "Traceback" not in result.output
    )


def test_ctrl_c_keeps_what_is_committed(folder):
    (folder / "many.toml").write_text(
        "shard_samples = 2\n" + CONFIG.replace("procedural = 4", "procedural = 40")
    )
    command = [sys.executable, "-m", "waveformer", "generate", "many.toml", "--out", "store"]
    # a test run in the background of a shell ignores Ctrl-C, and so would its children
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, before)
    deadline = time.monotonic() + 120
    while not list((folder / "store/commit").glob("*.json")) and time.monotonic() < deadline:
        time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "the same command goes on" in err and "Traceback" not in err
    assert open_dataset("store").num_pending < 40
    assert "all intact" in run("dataset", "verify", "store").stdout
    assert os.path.exists("store/dataset.json")
