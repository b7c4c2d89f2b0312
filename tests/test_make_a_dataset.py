"""Every command of docs/make_a_dataset.md runs as printed, on a folder of STL files in millimetres."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from waveformer.simulator import primitives

PAGE = (Path(__file__).resolve().parents[1] / "docs/make_a_dataset.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(sh|python)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_the_guide(tmp_path):
    (tmp_path / "meshes").mkdir()
    for name, mesh in (("mug", primitives.mug(0.004)), ("can", primitives.cylinder(0.03, 0.1, 0.004))):
        mesh.apply_scale(1000.0)
        mesh.export(tmp_path / "meshes" / f"{name}.stl")
    outputs = []
    for language, text in BLOCKS:
        commands = [[sys.executable, "-c", text]] if language == "python" else []
        for line in text.splitlines() if language == "sh" else ():
            program, *arguments = shlex.split(line)
            assert program == "waveformer"
            commands.append([sys.executable, "-m", "waveformer", *arguments])
        for command in commands:
            done = subprocess.run(
                command, cwd=tmp_path, capture_output=True, text=True, env=os.environ, check=False
            )
            assert done.returncode == 0, (command, done.stderr)
            outputs.append(done.stdout)
    assert "4 requested = 4 committed + 0 quarantined + 0 pending" in outputs[2]
    assert outputs[-1].splitlines() == 2 * ["(2, 1, 2048, 3) -> (2, 16384, 3)"]


def test_the_guide_names_every_step():
    text = "\n".join(block for _, block in BLOCKS)
    for step in ("catalog scan", "generate", "dataset verify", "propose", "data_loader"):
        assert step in text
