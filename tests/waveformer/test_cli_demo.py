"""`waveformer demo`: every result is there, and the numbers it explains are measured."""

import json
import time

import pytest
import trimesh
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.cli import demo as demo_module
from waveformer.cli.matter_config import BoxConfig
from waveformer.cli.scan_config import ApertureConfig, ChirpConfig, SimulateConfig

FILES = {"scan.zarr", "image.zarr", "range_profiles.png", "projections.png", "scene.png", "scene.html"}


@pytest.fixture
def tiny(monkeypatch):
    """A demo of a small ball in a small box before a small radar."""
    monkeypatch.setattr(demo_module, "_SPACING_M", 0.01)
    monkeypatch.setattr(demo_module, "_build", lambda name: trimesh.creation.icosphere(radius=0.02))
    monkeypatch.setattr(
        demo_module,
        "_settings",
        lambda mesh, name, seed: SimulateConfig(
            meshes=(str(mesh),),
            place_m=(0.0, 0.0, -0.4),
            # So few positions do not defocus the lid, so it is of a matter that swallows and hardly reflects.
            box=BoxConfig(material="1.02-0.05j", min_m=(-0.05, -0.05, -0.52), max_m=(0.05, 0.05, -0.25)),
            radar=ChirpConfig(start_hz=77e9, bandwidth_hz=4e9, num_samples=32),
            aperture=ApertureConfig(num_x=5, num_y=5, spacing_m=0.004),
            seed=seed,
        ),
    )


def test_demo_writes_everything_once(tiny, tmp_path):
    result = CliRunner().invoke(app, ["demo", "--out", str(tmp_path / "d"), "--json"])
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert {path.name for path in (tmp_path / "d").iterdir()} == FILES | {"mug.ply"}
    # A ball seen from 5 x 5 positions 16 mm wide at 40 cm: a cap of 5 degrees and half the aperture's angle
    # (1.6 degrees at the corners), so between (1 - cos 5) / 2 and (1 - cos 7) / 2; coarse facets widen it.
    assert 0.001 < report["specular_area_fraction"] < 0.01
    assert 0.0 < report["bright_area_fraction"] <= 1.0
    # Twice through 4 mm at 77 GHz to 81 GHz: 8.686 k d eps'' / sqrt(eps') = 2.84 dB; the faces return 1e-4 of it.
    assert report["lid_loss_db"] == pytest.approx(2.84, abs=0.02)
    assert report["lid_range_m"] == pytest.approx(0.25, abs=0.02)
    assert report["image_peak_m"] == pytest.approx([0, 0, -0.38], abs=0.02)

    again = CliRunner().invoke(app, ["demo", "--out", str(tmp_path / "d")])
    assert again.exit_code == 1
    assert "--force" in again.stderr
    forced = CliRunner().invoke(app, ["demo", "--out", str(tmp_path / "d"), "--force"])
    assert forced.exit_code == 0, forced.output
    assert "is what waveformer is for" in forced.stdout
    assert f"costs {report['lid_loss_db']:.1f} dB" in forced.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mug", "hammer"])
def test_full_demo_is_quick(tmp_path, name):
    started = time.perf_counter()
    result = CliRunner().invoke(app, ["demo", "--out", str(tmp_path), "--object", name, "--json"])
    assert result.exit_code == 0, result.output
    assert time.perf_counter() - started < 90
    report = json.loads(result.stdout)
    assert 0.01 < report["specular_area_fraction"] < 0.2
