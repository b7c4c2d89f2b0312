"""`waveformer reconstruct` as a user runs it: a ball under a small aperture."""

import dataclasses
import json

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.simulator import Aperture, Chirp, primitives, simulate

RADIUS_M = 0.04
CENTER_M = np.array([0.01, -0.01, -0.40])
BOX = ["--min", "-0.04", "-0.06", "-0.445", "--max", "0.06", "0.04", "-0.315"]


@pytest.fixture(scope="module")
def scan(mitsuba_variant):
    ball = primitives.sphere(RADIUS_M)
    ball.apply_translation(CENTER_M)
    return simulate(ball, Chirp(77.5001e9, 3.0009e9, 32), Aperture.planar_grid(40, 40, 0.004))


@pytest.fixture
def folder(tmp_path, monkeypatch, scan):
    scan.save(tmp_path / "scan.zarr")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WAVEFORMER_DEBUG", raising=False)
    return tmp_path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["reconstruct", *(str(argument) for argument in arguments)])
    assert result.exit_code == code, result.output
    return result


def test_a_ball_is_reconstructed_with_a_picture(folder):
    result = run("scan.zarr", "--out", "ball.ply", "--spacing", 0.004, *BOX, "--png", "--json")
    summary = json.loads(result.stdout)
    points = trimesh.load(folder / "ball.ply").vertices
    assert len(points) == summary["points"] > 100
    # a level is 1.9 mm from the next, and the choice may be one off
    assert np.median(np.abs(np.linalg.norm(points - CENTER_M, axis=1) - RADIUS_M)) < 2e-3
    assert 0.0 <= summary["confidence"] <= 1.0 and not summary["uncertain"]
    assert (folder / "ball.png").stat().st_size > 10_000


def test_backprojection_is_spread_over_the_range_resolution(folder):
    text = run(
        "scan.zarr", "--out", "bright.ply", "--method", "backprojection", "--spacing", 0.004, *BOX
    ).stdout
    points = trimesh.load(folder / "bright.ply").vertices
    assert "confidence" not in text
    off_m = np.abs(np.linalg.norm(points - CENTER_M, axis=1) - RADIUS_M)
    assert np.percentile(off_m, 75) > 5e-3  # of a range bin of 50 mm


def test_mmnorms_own_choice(folder):
    given = ("scan.zarr", "--method", "mmnorm", "--choice", "last_peak", "--spacing", 0.004, *BOX, "--json")
    summary = json.loads(run(*given, "--out", "mmnorm.ply").stdout)
    points = trimesh.load(folder / "mmnorm.ply").vertices
    assert summary["method"] == "mmnorm" and len(points) > 100
    # mmNorm prefers levels nearer to the radar
    assert np.median(np.abs(np.linalg.norm(points - CENTER_M, axis=1) - RADIUS_M)) < 6e-3


def test_the_same_seed_gives_the_same_cloud_and_nothing_is_replaced_unasked(folder):
    run("scan.zarr", "--out", "one.ply", "--spacing", 0.005, *BOX)
    first = (folder / "one.ply").read_bytes()
    assert "--force" in run("scan.zarr", "--out", "one.ply", "--spacing", 0.005, *BOX, code=1).stderr
    run("scan.zarr", "--out", "one.ply", "--spacing", 0.005, *BOX, "--force")
    assert (folder / "one.ply").read_bytes() == first


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--method", "magic"], "unknown method 'magic'"),
        (["--min", "0", "0", "0"], "give both --min X Y Z and --max X Y Z"),
        (["--min", "0", "0", "-0.3", "--max", "0.1", "0.1", "-0.4"], "--min must lie below --max"),
        (["--min", "1", "1", "-0.4", "--max", "1.1", "1.1", "-0.3"], "misses the imaged volume"),
        (["--spacing", "0.5"], "spacing_m"),
        (["--choice", "best"], "selection.choice"),
        (["--choice", "last_peak"], "--choice last_peak is a rule of mmNorm: add --method mmnorm"),
    ],
)
def test_bad_requests_are_one_line(folder, arguments, message):
    result = run("scan.zarr", "--out", "cloud.ply", *arguments, code=1)
    assert message in result.stderr and result.stderr.count("\n") == 1
    assert not (folder / "cloud.ply").exists()


def test_scans_that_show_nothing_say_why(folder, scan):
    dataclasses.replace(scan, h=np.zeros_like(scan.h)).save("zero.zarr")
    assert "the signal is zero" in run("zero.zarr", "--out", "cloud.ply", *BOX, code=1).stderr
    broken = scan.h.copy()
    broken[3, 4] = np.nan
    dataclasses.replace(scan, h=broken).save("broken.zarr")
    assert "non-finite" in run("broken.zarr", "--out", "cloud.ply", *BOX, code=1).stderr
    assert not (folder / "cloud.ply").exists()
    assert "does not exist" in run("missing.zarr", "--out", "cloud.ply", code=1).stderr
