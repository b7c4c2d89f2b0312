"""A small twin evaluated: a ball under a small aperture."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.datagen.twin_conditions import resolve_conditions
from waveformer.datagen.twin_objects import find_objects
from waveformer.datagen.twin_run import run_twin
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.eval.evaluate import evaluate_twin
from waveformer.eval.methods import METHODS, require_methods
from waveformer.model.proposal import ProposalSettings
from waveformer.simulator.errors import RadarError, StoreError

COARSE = ProposalSettings(spacing_m=0.004)
RADIUS_M = 0.04


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evaluate")
    (folder / "meshes").mkdir()
    trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_M).export(folder / "meshes" / "ball.ply")
    settings = TwinSettings(num_x=40, num_y=40, mode="fast", tessellation=0)
    conditions = resolve_conditions(["clean", "m40"])
    run_twin(folder / "twin", find_objects([folder / "meshes"]), conditions, settings, workers=1)
    return folder / "twin"


@pytest.fixture(scope="module")
def evaluated(root: Path, tmp_path_factory: pytest.TempPathFactory):
    out = tmp_path_factory.mktemp("scores")
    return out, *evaluate_twin(root, out, list(METHODS), conditions=["clean"], settings=COARSE)


def test_every_method_is_scored_with_and_without_registration(evaluated) -> None:
    _, table, (record,) = evaluated
    scored = {(row["method"], row["alignment"]) for row in record["scores"]}
    assert scored == {(method, alignment) for method in METHODS for alignment in ("known_pose", "icp")}
    assert record["size_class"] == "small"
    assert {row.method for row in table.rows} == set(METHODS)


def test_the_surface_is_right_and_the_image_is_not(evaluated) -> None:
    """A ball's image lies at its centre of curvature; its chosen level lies on it."""
    _, _, (record,) = evaluated
    precision = {
        row["method"]: row["score"]["precision"]
        for row in record["scores"]
        if row["alignment"] == "known_pose"
    }
    assert precision["mmnorm"] > 0.8
    assert precision["backprojection"] < 0.3
    (level,) = record["levels"]
    assert abs(level["error_m"]) < 4e-3
    assert level["median_distance_m"] < 2.5e-3


def test_files_and_pictures_are_there(evaluated) -> None:
    out, _, records = evaluated
    picture, scores = out / "clean" / "ball.png", out / "clean" / "ball.json"
    assert picture.stat().st_size > 10_000
    assert json.loads(scores.read_text()) == json.loads(json.dumps(records[0]))


def test_scores_are_used_again_if_nothing_changed(root: Path, tmp_path: Path) -> None:
    def run(seed: int) -> int:
        evaluate_twin(
            root, tmp_path, ["mmnorm"], conditions=["clean"], settings=COARSE, seed=seed, pictures=False
        )
        return os.stat(tmp_path / "clean" / "ball.json").st_mtime_ns

    first = run(0)
    assert run(0) == first
    assert run(1) > first


def test_unknown_names_are_refused(root: Path, tmp_path: Path) -> None:
    with pytest.raises(RadarError, match="unknown method 'magic'; known: backprojection"):
        require_methods(["magic"])
    with pytest.raises(StoreError, match="no scans of fog; it has clean, m40"):
        evaluate_twin(root, tmp_path, ["mmnorm"], conditions=["fog"])
    with pytest.raises(StoreError):
        evaluate_twin(tmp_path / "nowhere", tmp_path, ["mmnorm"])


def test_the_command_prints_the_table(root: Path, tmp_path: Path) -> None:
    arguments = [
        "evaluate",
        str(root),
        "--out",
        str(tmp_path / "out"),
        "--methods",
        "mmnorm",
        "--condition",
        "m40",
    ]
    result = CliRunner().invoke(app, [*arguments, "--spacing", "0.004", "--no-pictures"])
    assert result.exit_code == 0, result.output
    assert "| mmnorm | m40 | known_pose | 1 |" in result.stdout
    assert "mmNorm (paper)" in (tmp_path / "out" / "table.md").read_text()
    again = CliRunner().invoke(app, [*arguments, "--spacing", "0.004", "--no-pictures", "--json"])
    assert json.loads(again.stdout)["scans"] == 1


@pytest.mark.parametrize("method", ["mmnorm", "backprojection"])
def test_reconstruct_writes_a_cloud(root: Path, tmp_path: Path, method: str) -> None:
    cloud = tmp_path / "cloud.ply"
    box = ["--min", "-0.07", "-0.07", "-0.49", "--max", "0.07", "0.07", "-0.33"]
    scan = str(root / "clean" / "ball" / "scan.zarr")
    arguments = ["reconstruct", scan, "--out", str(cloud), "--method", method, "--spacing", "0.004", *box]
    result = CliRunner().invoke(app, [*arguments, "--png"])
    assert result.exit_code == 0, result.output
    points = np.asarray(trimesh.load(cloud).vertices)
    off_m = np.abs(np.linalg.norm(points - [0.0, 0.0, -0.45 + RADIUS_M], axis=1) - RADIUS_M)
    assert (np.median(off_m) < 2.5e-3) == (method == "mmnorm")
    assert (tmp_path / "cloud.png").stat().st_size > 10_000
    assert "exists" in CliRunner().invoke(app, arguments).stderr


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        (["--method", "magic"], "unknown method 'magic'"),
        (["--out", "cloud.xyz"], "written as PLY"),
        (["--min", "0", "0", "-0.4"], "give both --min"),
        (["--min", "0", "0", "-0.3", "--max", "1", "1", "-0.4"], "must lie below"),
        (["--min", "3", "3", "3", "--max", "4", "4", "4"], "misses the imaged volume"),
        (["--spacing", "0.5"], "spacing_m"),
        (["--field", "magic"], "field"),
    ],
)
def test_reconstruct_refuses_in_one_line(root: Path, tmp_path: Path, extra: list[str], message: str) -> None:
    arguments = [
        "reconstruct",
        str(root / "clean" / "ball" / "scan.zarr"),
        "--out",
        str(tmp_path / "c.ply"),
        *extra,
    ]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert message in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
