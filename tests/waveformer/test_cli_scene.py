"""`waveformer simulate` with materials, sheets, boxes, antennas and front ends, by flag, file and Mitsuba scene."""

import json
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.cli.scan_config import SimulateConfig
from waveformer.config import load_config
from waveformer.simulator import forward_stream
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.measurement import Measurement

RADAR = """
threads = 1
[radar]
start_hz = 77e9
bandwidth_hz = 4e9
num_samples = 16
"""
OBJECT = ("ball.ply", "--config", "radar.toml", "--aperture", "single", "--place", 0, 0, -0.3)
SCENE = """<scene version="3.0.0">
<shape type="ply"><string name="filename" value="ball.ply"/>
  <transform name="to_world"><translate z="-0.3"/></transform>
  <bsdf type="BSDF"><string name="material" value="abs"/></bsdf></shape>
<shape type="cube"><transform name="to_world"><scale x="0.05" y="0.05" z="0.06"/><translate z="-0.3"/></transform>
  <bsdf type="radar_sheet"><string name="material" value="cardboard"/><float name="thickness" value="0.003"/></bsdf>
</shape></scene>"""
BOX = "cardboard,thickness_m=0.003,min_m=-0.05 -0.05 -0.36,max_m=0.05 0.05 -0.24"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working directory with a ball, a radar and a scene."""
    trimesh.creation.icosphere(subdivisions=4, radius=0.02).export(tmp_path / "ball.ply")
    (tmp_path / "radar.toml").write_text(RADAR)
    (tmp_path / "scene.xml").write_text(SCENE.replace("BSDF", "radar_specular"))
    (tmp_path / "plastic.xml").write_text(SCENE.replace("BSDF", "roughplastic"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WAVEFORMER_DEBUG", raising=False)
    return tmp_path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["simulate", *map(str, arguments)])
    assert result.exit_code == code, result.output
    if code == 1:
        assert result.stderr.startswith("error: ")
        assert result.stderr.count("\n") == 1
        assert result.stdout == ""
    return result


def test_summary_tells_the_scene():
    report = json.loads(
        run(
            *OBJECT, "--material", "2.6-0.02j,thickness_m=0.002,roughness_m=1e-4", "--sheet",
            "foam,z_m=-0.1,thickness_m=0.01", "--sheet", "cardboard,z_m=-0.15,thickness_m=0.004,echo=true",
            "--box", "cardboard,margin_m=0.03,thickness_m=0.003", "--receivers", "mito", "--antenna", "iwr1443",
            "--front-end", "mito_nlos", "--polarization", 1, 0, 0, "--seed", 7, "--out", "scan.zarr", "--json",
        ).stdout
    )  # fmt: skip
    assert (report["positions"], report["samples"], report["seed"]) == (4, 16, 7)
    (target,) = report["targets"]
    assert target["material"]["permittivity"] == [2.6, -0.02]
    assert (target["material"]["thickness_m"], target["material"]["roughness_m"]) == (0.002, 1e-4)
    assert [sheet["point_m"][2] for sheet in report["sheets"]] == [-0.1, -0.15]
    assert [(sheet["name"], sheet["echo"]) for sheet in report["sheets"]] == [
        ("foam", False),
        ("cardboard", True),
    ]
    # 2 cm of ball, 3 cm of air, 3 mm of wall
    assert report["box"]["max_m"] == pytest.approx([0.053, 0.053, -0.247], abs=1e-6)
    assert report["box"]["min_m"] == pytest.approx([-0.053, -0.053, -0.353], abs=1e-6)
    assert report["antenna"]["beamwidths_deg"] == [56.0, 28.0]
    assert report["polarization"] == [1.0, 0.0, 0.0]
    assert FrontEnd(**report["front_end"]) == FrontEnd.from_preset("mito_nlos")
    assert Measurement.load("scan.zarr").range_bias_m == 0.15


def test_flags_file_and_scene_give_the_same_signal():
    run(*OBJECT, "--material", "abs", "--box", BOX, "--out", "flags.zarr")
    Path("scan.toml").write_text(
        f"""meshes = ["ball.ply"]
place_m = [0, 0, -0.3]
aperture = "single"
material = "abs"
{RADAR}
[box]
material = "cardboard"
thickness_m = 0.003
min_m = [-0.05, -0.05, -0.36]
max_m = [0.05, 0.05, -0.24]
"""
    )
    run("--config", "scan.toml", "--out", "file.zarr")
    run("scene.xml", "--config", "radar.toml", "--aperture", "single", "--out", "scene.zarr")
    flags, file, scene = (Measurement.load(f"{name}.zarr").h for name in ("flags", "file", "scene"))
    assert np.array_equal(flags, file)
    # the bound of the issue; a pose of 1e-17 m differs
    assert np.abs(scene - flags).max() <= 1e-6 * np.abs(flags).max()


def test_a_scene_is_imaged_and_drawn():
    run("scene.xml", "--config", "radar.toml", "--aperture", "single", "--out", "scan.zarr")
    viewed = CliRunner().invoke(app, ["view", "scan.zarr", "--out", "view.html", "--json"])
    assert json.loads(viewed.stdout)["layers"][1:] == ["mesh ball.ply", "box"]
    Path("scene.xml").write_text(Path("scene.xml").read_text().replace('z="-0.3"', 'z="-0.31"'))
    changed = CliRunner().invoke(app, ["view", "scan.zarr", "--out", "view.html", "--force"])
    assert "has changed since the scan" in changed.stderr


def test_a_front_end_section_goes_over_its_preset():
    Path("noisy.toml").write_text(
        RADAR
        + '[front_end]\npreset = "mito_nlos"\nmirror_snr_db = 20.0\n[front_end.dc_offset]\nlevel_db = -90.0\n'
    )
    settings = load_config(Path("noisy.toml"), SimulateConfig, {"meshes": ["ball.ply"]})
    assert settings.front_end is not None
    assert (settings.front_end.mirror_snr_db, settings.front_end.row_depth_error_m) == (20.0, 2e-4)
    assert settings.front_end.dc_offset is not None


@pytest.mark.parametrize(("preset", "positions"), [("mito_quarter_wave", 130_640), ("mito_raster", 44_110)])
def test_large_apertures_are_presets(preset, positions):
    settings = load_config(None, SimulateConfig, {"meshes": ["ball.ply"], "aperture": preset})
    assert len(settings.aperture.build()) == positions


def test_example_of_an_occluded_scan():
    with resources.as_file(resources.files("waveformer.configs") / "simulate_occluded.toml") as path:
        settings = load_config(path, SimulateConfig, {"meshes": ["mug.ply"]})
    assert settings.front_end == FrontEnd.from_preset("mito_nlos")
    assert settings.receivers == "mito"
    assert settings.box is not None


def test_an_interrupted_stream_goes_on_with_the_same_settings_only(monkeypatch):
    arguments = (*OBJECT, "--stream", "--workers", 1, "--out", "scan.zarr")
    whole = forward_stream._computed

    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(forward_stream, "_computed", stopped)
    interrupted = run(*arguments, code=130)
    assert interrupted.stderr.startswith("interrupted; ")
    assert "--resume goes on" in interrupted.stderr
    assert not Path("scan.zarr").exists()

    assert "go on with --resume" in run(*arguments, code=1).stderr
    assert "was begun with different" in run(*arguments, "--resume", "--seed", 5, code=1).stderr
    monkeypatch.setattr(forward_stream, "_computed", whole)
    report = json.loads(run(*arguments, "--resume", "--json").stdout)
    assert report["streamed"] is True
    streamed = Measurement.load("scan.zarr")
    assert "workers" not in streamed.metadata["config"]

    assert "exists; pass --force" in run(*arguments, "--resume", code=1).stderr
    in_memory = json.loads(run(*OBJECT, "--out", "memory.zarr", "--json").stdout)
    assert in_memory["streamed"] is False
    assert in_memory["peak_db"] == pytest.approx(report["peak_db"], abs=1e-4)
    # one thread in both; the same sum
    assert np.array_equal(Measurement.load("memory.zarr").h, streamed.h)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([*OBJECT, "--material", "unobtainium"], "unknown material 'unobtainium'; known: abs, acrylic"),
        ([*OBJECT, "--material", "0.5"], "eps' >= 1"),
        ([*OBJECT, "--material", "2.6+0.02j"], "so 1.5-0.05j"),
        (
            [*OBJECT, "--material", "abs,thicknes_m=0.003"],
            "'material.thicknes_m', did you mean 'thickness_m'?",
        ),
        ([*OBJECT, "--material", "abs,thickness_m=thin"], "expected a valid number, got 'thin'"),
        ([*OBJECT, "--material", "abs,0.003"], "'0.003' has no value"),
        ([*OBJECT, "--material", "pec,thickness_m=0.003"], "has no thickness_m"),
        ([*OBJECT, "--material", "abs,roughness_m=1"], "roughness_m must lie in"),
        ([*OBJECT, "--sheet", "cardboard,z_m=-0.1"], "key 'sheets[0].thickness_m' is missing"),
        ([*OBJECT, "--sheet", "vibranium,z_m=-0.1,thickness_m=0.01"], "unknown material 'vibranium'"),
        ([*OBJECT, "--sheet", "foam,z_m=-0.1,thickness_m=0.01,echo=1"], "'sheets[0].echo'"),
        (
            [*OBJECT, "--box", "cardboard,min_m=-0.1 -0.1 -0.4,max_m=0.1 0.1 -0.3"],
            "through a wall of the box",
        ),
        ([*OBJECT, "--box", "cardboard,margin_m=0.3"], "aperture"),
        ([*OBJECT, "--box", "cardboard,margin_m=-0.01"], "must not be negative"),
        ([*OBJECT, "--box", "cardboard,min_m=-0.1 -0.1 -0.4"], "give both, or neither"),
        ([*OBJECT, "--box", f"{BOX},margin_m=0.1"], "give one"),
        ([*OBJECT, "--box", "pec"], "unknown material 'pec'"),
        (
            [*OBJECT, "--front-end", "cheap"],
            "unknown front end preset 'cheap'; known: ideal, iwr1443, mito_los",
        ),
        ([*OBJECT, "--antenna", "dish"], "unknown antenna preset 'dish'; known: iwr1443"),
        ([*OBJECT, "--receivers", "many"], "unknown receiver preset 'many'; known: mito, mito_y"),
        ([*OBJECT, "--polarization", 0, 0, 0], "polarization must be a direction"),
        ([*OBJECT, "--workers", 0], "'workers'"),
        (["plastic.xml"], "knows no BSDF 'roughplastic'; known: radar_sheet, radar_specular"),
        (["absent.xml"], "absent.xml: no such scene file"),
        (["scene.xml", "ball.ply"], "a scene file comes alone"),
        (["scene.xml", "--place", 0, 0, -0.3], "place_m: a scene file says this"),
        (["scene.xml", "--material", "abs"], "material: a scene file says this"),
        (["scene.xml", "--box", "cardboard"], "leave one of them out"),
        (["ball.ply", "--config", "front.toml"], "FrontEnd: unknown snr; known: snr_db, mirror_snr_db"),
        (["ball.ply", "--config", "both.toml"], "for a grid, or row_length_m"),
        (["ball.ply", "--config", "widths.toml"], "give both, or neither"),
    ],
)
def test_errors_are_one_line(arguments, expected):
    Path("front.toml").write_text("[front_end]\nsnr = 20.0\n")
    Path("both.toml").write_text("[aperture]\nnum_x = 3\nnum_y = 3\nnum_rows = 4\n")
    Path("widths.toml").write_text("[antenna]\nbeamwidth_x_deg = 30.0\n")
    assert expected in run(*arguments, "--out", "scan.zarr", code=1).stderr
    assert not Path("scan.zarr").exists()
