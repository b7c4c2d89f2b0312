"""`waveformer simulate`, `image` and `view` as a user runs them, on a tiny scene."""

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.cli.scan_config import SimulateConfig
from waveformer.cli.scan_scene import scene_pose
from waveformer.config import load_config
from waveformer.simulator.image import Image
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.presets import APERTURE_PRESETS, CHIRP_PRESETS

CONFIG = """
meshes = ["ball.ply"]
place_m = [0.0, 0.0, -0.3]
threads = 1
[radar]
start_hz = 77e9
bandwidth_hz = 4e9
num_samples = 32
[aperture]
num_x = 5
num_y = 5
spacing_m = 0.004
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with a ball of 4 cm around the origin and a configuration for it."""
    trimesh.creation.icosphere(subdivisions=4, radius=0.02).export(tmp_path / "ball.ply")
    (tmp_path / "scan.toml").write_text(CONFIG)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WAVEFORMER_DEBUG", raising=False)
    return tmp_path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    if code == 1:  # an error of the user is one line, and only that
        assert result.stderr.startswith("error: ")
        assert result.stderr.count("\n") == 1
        assert result.stdout == ""
    return result


@pytest.fixture
def scan(folder):
    run("simulate", "--config", "scan.toml", "--out", "scan.zarr")
    return folder / "scan.zarr"


def test_simulate_image_view(folder, scan):
    measurement = Measurement.load(scan)
    assert measurement.h.shape == (25, 32)
    assert measurement.metadata["config"]["place_m"] == [0.0, 0.0, -0.3]
    (record,) = measurement.metadata["meshes"]
    assert record["path"] == str(folder / "ball.ply")
    assert len(record["sha256"]) == 64

    report = json.loads(
        run("image", "scan.zarr", "--out", "image.zarr", "--spacing", 0.006, "--png", "--json").stdout
    )
    image = Image.load("image.zarr")
    assert report["voxels"] == list(image.grid.shape) == [17, 17, 17]  # 4 cm and twice 3 cm of margin
    assert image.grid.z[[0, -1]] == pytest.approx([-0.35, -0.254], abs=1e-3)
    # The ball's top at z = -0.28 is what shines; a range bin is 3.7 cm, a voxel 6 mm.
    assert report["peak_m"] == pytest.approx([0, 0, -0.28], abs=0.0091)
    assert (folder / "image.png").stat().st_size > 5000

    for suffix in ("html", "png"):
        shown = json.loads(run("view", "scan.zarr", "image.zarr", "--out", f"view.{suffix}", "--json").stdout)
        assert shown["layers"].count("mesh ball.ply") == 1
        assert {"antenna positions", "image at -6 dB of its peak"} <= set(shown["layers"])
        assert (folder / f"view.{suffix}").stat().st_size > 5000


def test_summary_tells_the_echo(folder):
    report = json.loads(run("simulate", "--config", "scan.toml", "--out", "scan.zarr", "--json").stdout)
    assert (report["positions"], report["samples"]) == (25, 32)
    assert report["peak_range_m"] == pytest.approx(0.28, abs=0.01)
    # A sphere in physical optics: radar cross-section pi r^2, so |h| = sqrt(pi) r lambda / ((4 pi)^1.5 R^2)
    # with R to its centre's near side in the limit of small r / R; 1 dB covers the finite ratio.
    wavelength_m = 299_792_458.0 / 79e9
    expected = np.sqrt(np.pi) * 0.02 * wavelength_m / ((4 * np.pi) ** 1.5 * 0.28 * 0.30)
    assert report["peak_db"] == pytest.approx(20 * np.log10(expected), abs=1.0)


def test_options_go_over_the_file(folder):
    run(
        "simulate",
        "--config",
        "scan.toml",
        "--radar",
        "24ghz",
        "--aperture",
        "single",
        "--seed",
        7,
        "--out",
        "s.zarr",
    )
    measurement = Measurement.load("s.zarr")
    assert measurement.h.shape == (1, 256)
    assert measurement.chirp.start_hz == 24.025e9
    assert measurement.metadata["seed"] == 7


def test_two_meshes_keep_their_places(folder):
    trimesh.creation.icosphere(radius=20).apply_translation((60, 0, 0)).export("other.ply")
    trimesh.creation.icosphere(radius=20).export("ball.stl")
    run("simulate", "ball.stl", "other.ply", "--config", "scan.toml", "--unit", "mm", "--out", "s.zarr")
    bounds_m = [target["bounds_m"] for target in Measurement.load("s.zarr").metadata["targets"]]
    assert np.mean(bounds_m, axis=1) == pytest.approx(np.array([[-0.03, 0, -0.3], [0.03, 0, -0.3]]), abs=1e-6)


def test_rotation_is_about_fixed_x_then_y_then_z():
    mesh = load_mesh(trimesh.creation.box((0.2, 0.1, 0.04)).apply_translation((1, 2, 3)))
    pose = scene_pose([mesh], (0.0, 0.0, -0.4), (90.0, 0.0, 90.0))
    # x: y -> z; then z: x -> y. So the box's x side ends along y and its y side along z.
    assert pose @ [1.1, 2, 3, 1] == pytest.approx([0, 0.1, -0.4, 1])
    assert pose @ [1, 2.05, 3, 1] == pytest.approx([0, 0, -0.35, 1])
    assert scene_pose([mesh], None, (0.0, 0.0, 0.0)) == pytest.approx(np.eye(4))


def test_a_moved_mesh_is_found_again(folder, scan):
    Path("ball.ply").rename("renamed.ply")
    result = run("view", "scan.zarr", "--out", "view.html")
    assert "no longer there and not drawn; --mesh FILE" in result.stderr
    assert "mesh renamed.ply" in run("view", "scan.zarr", "--mesh", "renamed.ply", "--out", "v.html").stdout
    Path("ball.ply").write_bytes(Path("renamed.ply").read_bytes() + b"\n")
    assert "has changed since the scan" in run("view", "scan.zarr", "--out", "view.html", "--force").stderr


def test_example_config_is_the_mito_preset():
    with resources.as_file(resources.files("waveformer.configs") / "simulate_mito.toml") as path:
        config = load_config(path, SimulateConfig, {"meshes": ["mug.ply"]})
    assert config.radar.model_dump() == CHIRP_PRESETS["mito"]
    assert APERTURE_PRESETS["mito"].items() <= config.aperture.model_dump().items()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["absent.ply"], "absent.ply"),
        (["ball.ply", "--radar", "99ghz"], "unknown radar preset '99ghz'; known: mito, 77-81ghz, 24ghz"),
        (["ball.ply", "--aperture", "huge"], "unknown aperture preset 'huge'; known: small, mito, single"),
        (["ball.ply"], "--place 0 0 -0.4"),  # it lies around the origin, in the aperture
        (["ball.ply", "--place", 0, 0, -100], "unambiguous range"),
        (["ball.ply", "--place", 0, 0, -0.4, "--unit", "mm"], "--unit m"),
        (["ball.ply", "--place", "nan", 0, -0.4], "finite"),
        (["ball.ply", "--unit", "furlong"], "'unit'"),
        (["ball.ply", "--mode", "magic"], "'mode'"),
        (["ball.ply", "--threads", 0], "'threads'"),
        (["--config", "absent.toml"], "absent.toml: no such configuration file"),
        ([], "'meshes' is missing"),
        (["--config", "typo.toml"], "unknown key 'radar.start_ghz', did you mean 'start_hz'?"),
        (["--config", "nonsense.toml"], "start_hz 77 lies outside 0.1 GHz .. 1 THz"),
    ],
)
def test_errors_are_one_line(folder, arguments, expected):
    Path("typo.toml").write_text(CONFIG.replace("start_hz", "start_ghz"))
    Path("nonsense.toml").write_text(CONFIG.replace("77e9", "77.0").replace("4e9", "4.0"))
    assert expected in run("simulate", *arguments, "--out", "scan.zarr", code=1).stderr
    assert not Path("scan.zarr").exists()


def test_existing_results_are_kept(folder, scan):
    before = Measurement.load(scan).h.tobytes()
    for arguments in (
        ("simulate", "--config", "scan.toml", "--out", "scan.zarr"),
        ("image", "scan.zarr", "--out", "scan.zarr", "--force"),  # never an image over the scan it is made of
        ("view", "scan.zarr", "--out", "ball.ply"),
    ):
        run(*arguments, code=1)
    assert Measurement.load(scan).h.tobytes() == before
    run("simulate", "--config", "scan.toml", "--out", "scan.zarr", "--seed", 3, "--force")
    assert Measurement.load(scan).metadata["seed"] == 3


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["image", "absent.zarr", "--out", "i.zarr"], "absent.zarr does not exist"),
        (["image", "ball.ply", "--out", "i.zarr"], "not a waveformer store"),
        (["image", "bare.zarr", "--out", "i.zarr"], "--min X Y Z and --max X Y Z"),
        (["image", "bare.zarr", "--out", "i.zarr", "--min", 0, 0, 0, "--max", 0, 0, -1], "min_m <= max_m"),
        (["image", "bare.zarr", "--out", "ball.ply/i.zarr"], "cannot write"),
        (["view", "absent.zarr"], "absent.zarr does not exist"),
        (["view", "."], "neither a scan nor an image"),
        (["view", "bare.zarr", "--out", "view.jpg"], ".html or .png"),
        (["view", "bare.zarr", "--mesh", "ball.ply"], "records 0"),
        (["view", "ball.ply", "--unit", "pc"], "unknown unit 'pc'; known: m, cm, mm, in"),
    ],
)
def test_errors_of_image_and_view_are_one_line(folder, arguments, expected):
    from waveformer.simulator.radar import Aperture, Chirp

    Measurement(np.zeros((1, 8), np.complex64), Chirp(77e9, 4e9, 8), Aperture(np.zeros((1, 3)))).save(
        "bare.zarr"
    )
    assert expected in run(*arguments, code=1).stderr
