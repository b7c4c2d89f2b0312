"""`waveformer twin` as a user runs it, on tiny scenes."""

import json
from importlib import resources

import pytest
import trimesh
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.cli.twin_config import TwinConfig
from waveformer.config import load_config
from waveformer.datagen.twin_conditions import CONDITIONS
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.datagen.twin_store import twin_scans

CONFIG = """
meshes = ["meshes"]
conditions = ["clean", "m40"]
mode = "fast"
workers = 1
[aperture]
num_x = 4
num_y = 3
"""


@pytest.fixture
def folder(tmp_path, monkeypatch, mitsuba_variant):
    """A working directory with two meshes and a configuration for a tiny aperture."""
    (tmp_path / "meshes").mkdir()
    trimesh.creation.icosphere(subdivisions=2, radius=0.02).export(tmp_path / "meshes/ball.ply")
    trimesh.creation.box((0.02, 0.03, 0.2)).export(tmp_path / "meshes/tower.ply")
    (tmp_path / "twin.toml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WAVEFORMER_DEBUG", raising=False)
    return tmp_path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["twin", *(str(argument) for argument in arguments)])
    assert result.exit_code == code, result.output
    return result


def test_a_twin_and_the_rest_of_it(folder):
    summary = json.loads(run("--config", "twin.toml", "--out", "root", "--limit", 1, "--json").stdout)
    assert (summary["written"], summary["kept"], summary["scans"], summary["failures"]) == (2, 0, 2, [])
    result = run("--config", "twin.toml", "--out", "root")
    assert "2 objects x clean, m40: 2 scans made, 2 there before, 0 failed" in result.stdout
    assert "scans: 4 of 4" in result.stderr
    assert len(twin_scans("root")) == 4


def test_failures_are_told_and_the_exit_code_is_honest(folder):
    result = run("--config", "twin.toml", "--condition", "nlos", "--out", "root", "--json", code=1)
    summary = json.loads(result.stdout)
    assert (summary["written"], summary["conditions"]) == (1, ["box"])
    (failure,) = summary["failures"]
    assert (failure["object_id"], failure["condition"]) == ("tower", "box")
    assert "note: box/tower not made: tower: its top" in result.stderr


def test_options_go_over_the_file(folder):
    arguments = ("meshes/ball.ply", "--condition", "los", "--seed", 5, "--tessellation", 0)
    run("--config", "twin.toml", *arguments, "--out", "root")
    (scan,) = twin_scans("root")
    assert scan.condition == "clean"
    assert scan.record["identity"]["settings"]["seed"] == 5
    assert scan.record["identity"]["settings"]["tessellation"] == 0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["absent"], "absent does not exist"),
        ([], "'meshes' is missing"),
        (["meshes", "--condition", "fog"], "unknown condition 'fog'; known: clean, m40"),
        (["meshes", "--mode", "magic"], "'mode'"),
        (["meshes", "--tessellation", 9], "tessellation must be 0 .. 4"),
        (["meshes", "--limit", 0], "'limit'"),
        (["meshes", "--workers", 0], "'workers'"),
        (["--config", "coarse.toml"], "5 mm aliases"),
        (["--config", "typo.toml"], "did you mean 'conditions'?"),
    ],
)
def test_errors_are_one_line(folder, arguments, expected):
    (folder / "coarse.toml").write_text(CONFIG + "spacing_m = 0.005\n")
    (folder / "typo.toml").write_text(CONFIG.replace("conditions", "condition"))
    result = run(*arguments, "--out", "root", code=1)
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert expected in result.stderr
    assert not (folder / "root").exists()


def test_other_settings_are_refused(folder):
    run("--config", "twin.toml", "--out", "root", "--limit", 1)
    result = run("--config", "twin.toml", "--out", "root", "--mode", "exact", code=1)
    assert "root holds a twin of other settings" in result.stderr


def test_ctrl_c_says_what_is_kept(folder, monkeypatch):
    def interrupted(*_arguments, progress, **_more):
        from waveformer.datagen.twin_run import TwinProgress

        progress(TwinProgress(total=4, kept=1, written=2))
        raise KeyboardInterrupt

    monkeypatch.setattr("waveformer.datagen.twin_run.run_twin", interrupted)
    result = run("--config", "twin.toml", "--out", "root", code=130)
    assert "3 of 4 scans are kept: the same command goes on" in result.stderr


def test_example_config_says_the_defaults():
    with resources.as_file(resources.files("waveformer.configs") / "twin_mito.toml") as path:
        config = load_config(path, TwinConfig, {"meshes": ["meshes"]})
    assert config.build() == TwinSettings()
    assert config.conditions == tuple(CONDITIONS)
