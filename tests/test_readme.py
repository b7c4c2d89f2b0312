"""What the README promises: its examples run as printed, its commands exist, its links lead somewhere."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waveformer.cli import app
from waveformer.simulator import Image, Measurement, load_scene, primitives
from waveformer.simulator.permittivity import PERMITTIVITIES
from waveformer.simulator.slab import fresnel_reflection

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def fenced(language: str) -> str:
    """The one code block in this language."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 1
    return blocks[0]


def run(arguments: list[str], folder: Path) -> str:
    done = subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_python_example(tmp_path):
    output = run([sys.executable, "-c", fenced("python")], tmp_path)
    place = [float(value) for value in re.findall(r"-?\d+\.\d*", output)]
    scan, image = Measurement.load(tmp_path / "hammer_scan.zarr"), Image.load(tmp_path / "hammer_image.zarr")
    assert scan.h.shape == (3600, 512)
    assert place == pytest.approx(image.peak_position_m, abs=1e-6)
    # within the hammer, 32 mm thick around z = -0.35: a rounded surface focuses at its centre of curvature
    assert -0.366 < place[2] < -0.334


@pytest.mark.slow
def test_shell_example(tmp_path):
    primitives.hammer().export(tmp_path / "mesh.ply")
    for line in fenced("sh").splitlines():
        program, *arguments = shlex.split(line)
        assert program == "waveformer"
        run([sys.executable, "-m", "waveformer", *arguments], tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"mesh.ply", "scan.zarr", "image.zarr", "view.html"}


def test_gradients_of_the_docs(tmp_path):
    page = (ROOT / "docs" / "inverse_problems.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    leaves = "(vertices, tx, permittivity, sheet.thickness_m)"
    output = run(
        [sys.executable, "-c", f"{text}\nprint([float(leaf.grad.abs().max()) for leaf in {leaves}])"],
        tmp_path,
    )
    largest = [float(value) for value in re.findall(r"\d[\d.e+-]*", output)]
    assert len(largest) == 4
    assert min(largest) > 0


def test_scene_of_the_docs(tmp_path, mitsuba_variant):
    page = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```xml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / "scene.xml").write_text(text)
    scene = load_scene(tmp_path / "scene.xml")
    assert [target.material.name for target in scene.targets] == ["abs", "pec"]
    assert [sheet.echo for sheet in scene.sheets] == [True]
    assert scene.box is not None


def test_materials_of_the_docs():
    """The table names every material, with its permittivity and its echo at 79 GHz, as rounded there."""
    page = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?`) \| ([\d.]+) \| (\S+) \| (\S+) dB \|", page, re.MULTILINE)
    named = {name: numbers for names, *numbers in rows for name in re.findall(r"`(\w+)`", names)}
    assert named.keys() == PERMITTIVITIES.keys()
    for name, (real, loss, echo_db) in named.items():
        value = PERMITTIVITIES[name].at(79e9)
        assert value.real == pytest.approx(float(real), abs=0.0051)
        if name != "metal":
            assert -value.imag == pytest.approx(float(loss), abs=0.0051)
        reflected_db = 20 * np.log10(abs(fresnel_reflection(value, 1.0).s))
        assert reflected_db == pytest.approx(float(echo_db.replace("−", "-")), abs=0.051)


def test_examples_compile():
    compile(fenced("python"), "README.md", "exec")


def test_every_command_of_the_table_exists():
    named = re.findall(r"^\| `waveformer (\w+)` \|", README, re.MULTILINE)
    registered = {command.name or command.callback.__name__ for command in app.registered_commands}
    registered |= {group.name for group in app.registered_groups}
    assert named
    assert set(named) <= registered


@pytest.mark.parametrize("page", ["README.md", *(f"docs/{p.name}" for p in (ROOT / "docs").glob("*.md"))])
def test_links(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (ROOT / page).parent.joinpath(target).exists(), f"{page}: {target}"
