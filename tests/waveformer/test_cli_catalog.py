"""`waveformer catalog` as a user runs it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest
import trimesh
from typer.testing import CliRunner

from waveformer.cli import app
from waveformer.datagen.catalog import Catalog

# A background job inherits Ctrl-C ignored.
CLI = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from waveformer.cli import main; main()"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory with two balls in millimetres and a web page saved as an STL."""
    for number, height in enumerate((0.4, 0.6)):
        mesh = trimesh.creation.icosphere(subdivisions=1, radius=50.0).apply_scale([1, 0.8, height])
        (tmp_path / "meshes").mkdir(exist_ok=True)
        mesh.export(tmp_path / f"meshes/ball{number}.stl")
    (tmp_path / "meshes/page.stl").write_text("<html>404</html>")
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("WAVEFORMER_DEBUG", raising=False)
    return tmp_path


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["catalog", *(str(argument) for argument in arguments)])
    assert result.exit_code == code, result.output
    return result


def test_scan_and_show(folder):
    result = run("scan", "meshes", "--out", "c.parquet", "--unit", "mm", "--workers", 1)
    assert "c.parquet: 3 objects of meshes: 2 usable" in result.stdout
    assert "note: folder/page.stl cannot be used: page.stl: a web page, not a mesh" in result.stderr
    assert "meshes: 3 of 3" in result.stderr
    assert sorted(path.name for path in folder.iterdir()) == ["c.parquet", "meshes"]
    catalog = Catalog.read("c.parquet")
    assert [entry.longest_side_m for entry in catalog.entries[:2]] == pytest.approx([0.1, 0.1], rel=0.03)
    assert "3 objects" in run("show", "c.parquet").stdout
    records = [json.loads(line) for line in run("show", "c.parquet", "--json").stdout.splitlines()]
    assert [record["object_id"] for record in records] == [
        f"folder/{n}.stl" for n in ("ball0", "ball1", "page")
    ]
    assert (records[0]["unit_m"], records[2]["longest_side_m"]) == (0.001, None)


def test_the_summary_as_json(folder):
    result = run(
        "scan", "meshes", "--out", "c.parquet", "--json", "--workers", 2, "--held-out", make_held_out(folder)
    )
    summary = json.loads(result.stdout)
    assert (summary["objects"], summary["usable"], summary["unusable"]) == (3, 1, 2)
    assert (summary["unit_unknown"], summary["licences"]) == (1, {"unknown": 1})
    assert "kept out: the same shape as folder/other.ply" in result.stderr


def make_held_out(folder):
    (folder / "held").mkdir()
    trimesh.load(folder / "meshes/ball0.stl").export(folder / "held/other.ply")
    run("scan", "held", "--out", "held.parquet", "--unit", "mm")
    return "held.parquet"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["absent"], "absent is not a folder"),
        (["meshes", "--source", "toys4k"], "meshes holds no Toys4K mesh"),
        (["meshes", "--source", "shapenet"], "unknown source 'shapenet'; known: omniobject3d"),
        (["meshes", "--unit", "furlong"], "unknown unit 'furlong'"),
        (["meshes", "--unit", "-1"], "unknown unit '-1'"),
        (["meshes", "--up-axis", "up"], "unknown up axis 'up'"),
        (["meshes", "--held-out", "none.parquet"], "none.parquet does not exist"),
    ],
)
def test_errors_are_one_line(folder, arguments, expected):
    result = run("scan", *arguments, "--out", "c.parquet", code=1)
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert expected in result.stderr
    assert not (folder / "c.parquet").exists()


def test_an_existing_catalogue_is_replaced_on_request_only(folder):
    run("scan", "meshes", "--out", "c.parquet")
    assert "c.parquet exists; pass --force" in run("scan", "meshes", "--out", "c.parquet", code=1).stderr
    run("scan", "meshes", "--out", "c.parquet", "--force")


def test_ctrl_c_stops_cleanly_and_the_same_command_goes_on(folder):
    for number in range(150):
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=50.0)
        mesh.apply_scale([1, 1 - 0.002 * number, 0.5]).export(folder / f"meshes/more{number}.ply")
    command = [sys.executable, "-c", CLI, "catalog", "scan", "meshes", "--out", "c.parquet", "--unit", "mm"]
    command += ["--workers", "2"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    journal = folder / ".c.parquet.unfinished"
    deadline = time.monotonic() + 30
    while not journal.exists() or journal.read_text().count("\n") < 5:
        assert time.monotonic() < deadline
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    try:
        _, errors = process.communicate(timeout=15)
    finally:
        process.kill()
    assert process.returncode == 130
    assert errors.splitlines()[-1] == "interrupted; what was loaded is kept: the same command goes on"
    assert not (folder / "c.parquet").exists()
    kept = journal.read_text().count("\n")
    result = run("scan", "meshes", "--out", "c.parquet", "--unit", "mm")
    assert "153 objects" in result.stdout
    assert kept >= 5
    assert not journal.exists()
