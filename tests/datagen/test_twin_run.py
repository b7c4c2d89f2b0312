"""Twins on disk: made, gone on with, refused."""

import json
import shutil

import numpy as np
import pytest
import trimesh

from waveformer.datagen.twin_conditions import resolve_conditions
from waveformer.datagen.twin_objects import find_objects
from waveformer.datagen.twin_run import run_twin
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.datagen.twin_store import difference, twin_scans
from waveformer.simulator.errors import RadarError, StoreError

SETTINGS = TwinSettings(num_x=4, num_y=3, mode="fast")


@pytest.fixture
def meshes(tmp_path, mitsuba_variant):
    folder = tmp_path / "meshes"
    folder.mkdir()
    trimesh.creation.icosphere(subdivisions=2, radius=0.02).export(folder / "ball.ply")
    trimesh.creation.box((0.02, 0.03, 0.04)).export(folder / "003_block.ply")
    return folder


def make(root, meshes, *names, settings=SETTINGS, **arguments):
    state = run_twin(
        root, find_objects([meshes]), resolve_conditions(names), settings, workers=1, **arguments
    )
    return state.written, state.kept, len(state.failures)


def contents(root):
    return {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}


def test_scans_and_their_truth(tmp_path, meshes):
    seen = []
    done = make(tmp_path / "twin", meshes, "clean", "m40", "box", progress=lambda now: seen.append(now.done))
    assert done == (6, 0, 0)
    assert seen == [0, 2, 3, 5, 6]
    scans = twin_scans(tmp_path / "twin")
    assert [(scan.condition, scan.object_id) for scan in scans] == [
        (condition, name) for condition in ("box", "clean", "m40") for name in ("003_block", "ball")
    ]
    ball = scans[3]
    measurement = ball.measurement()
    assert measurement.h.shape == (12, 64)
    assert ball.scan_path == tmp_path / "twin/clean/ball/scan.zarr"
    truth = ball.truth_mesh()
    assert truth.vertices_m[:, 2].min() == pytest.approx(-0.45, abs=1e-7)
    # PLY holds single precision
    bounds_m = np.array([truth.vertices_m.min(axis=0), truth.vertices_m.max(axis=0)])
    assert bounds_m == pytest.approx(np.array(ball.record["bounds_m"]), abs=1e-7)
    assert ball.crop_m == pytest.approx(bounds_m + [[-0.03, -0.03, -0.045], [0.03, 0.03, 0.045]], abs=1e-7)
    assert ball.record["support_z_m"] == -0.45
    assert ball.record["identity"]["settings"]["seed"] == 0
    assert set(ball.record["versions"]) == {"waveformer", "numpy", "mitsuba", "drjit"}
    assert measurement.metadata["twin"] == {"condition": "clean", "reflectivity": ball.record["reflectivity"]}
    # the ball's top is 0.41 m away, within the range bin of 5 cm
    range_m, magnitude = measurement.range_profile()
    assert range_m[magnitude.max(axis=0).argmax()] == pytest.approx(0.41, abs=0.025)


def test_a_second_run_makes_what_is_missing(tmp_path, meshes):
    root = tmp_path / "twin"
    assert make(root, meshes, "clean", "m40", "rows") == (6, 0, 0)
    complete = contents(root)
    assert make(root, meshes, "clean", "m40", "rows") == (0, 6, 0)
    assert contents(root) == complete

    shutil.rmtree(root / "m40/ball")
    (root / "rows/.ball.x.partial").mkdir()
    assert make(root, meshes, "clean", "m40", "rows") == (1, 5, 0)
    assert not (root / "rows/.ball.x.partial").exists()
    # made of the clean scan, not of a new echo, and the same to the last bit
    for path, content in complete.items():
        if "h/c" in path.as_posix():
            assert path.read_bytes() == content


def test_the_same_settings_give_the_same_signals(tmp_path, meshes):
    one, two = tmp_path / "one", tmp_path / "two"
    make(one, meshes, "m30", "clean")
    make(two, meshes, "clean")
    make(two, meshes, "m30")
    for first, second in zip(twin_scans(one), twin_scans(two), strict=True):
        assert (first.measurement().h == second.measurement().h).all()
    m30 = {scan.object_id: scan.measurement().h for scan in twin_scans(one) if scan.condition == "m30"}
    clean = {scan.object_id: scan.measurement().h for scan in twin_scans(one) if scan.condition == "clean"}
    noise = [m30[name] - clean[name] for name in ("ball", "003_block")]
    correlation = abs(np.vdot(*noise)) / np.prod([np.linalg.norm(part) for part in noise])
    # independent between objects: 768 samples correlate by about 1 / sqrt(768) = 0.036
    assert correlation < 4 * 0.036


def test_other_settings_are_refused(tmp_path, meshes):
    root = tmp_path / "twin"
    make(root, meshes, "clean")
    before = contents(root)
    with pytest.raises(StoreError, match="other settings \\(seed: 0, not 1\\)"):
        make(root, meshes, "clean", settings=TwinSettings(num_x=4, num_y=3, mode="fast", seed=1))
    with pytest.raises(StoreError, match="num_x: 4, not 5"):
        make(root, meshes, "clean", settings=TwinSettings(num_x=5, num_y=3, mode="fast"))
    trimesh.creation.icosphere(subdivisions=2, radius=0.03).export(meshes / "ball.ply")
    with pytest.raises(StoreError, match="ball was made otherwise \\(mesh_sha256"):
        make(root, meshes, "clean")
    with pytest.raises(StoreError, match="mesh_sha256"):
        make(root, meshes, "m40")
    assert contents(root).keys() == before.keys()


def test_a_folder_with_something_else_is_refused(tmp_path, meshes):
    root = tmp_path / "photos"
    root.mkdir()
    (root / "me.jpg").touch()
    with pytest.raises(StoreError, match="holds no twin"):
        make(root, meshes, "clean")
    assert [path.name for path in root.iterdir()] == ["me.jpg"]
    with pytest.raises(StoreError, match="holds no twin"):
        make(root / "me.jpg", meshes, "clean")


def test_one_bad_mesh_does_not_stop_the_others(tmp_path, meshes):
    (meshes / "broken.ply").write_text("no mesh")
    trimesh.creation.box((0.02, 0.02, 0.2)).export(meshes / "tower.ply")
    state = run_twin(
        tmp_path / "twin",
        find_objects([meshes]),
        resolve_conditions(["clean", "m40", "sheet"]),
        SETTINGS,
        workers=1,
    )
    assert (state.written, state.kept) == (8, 0)
    failed = {(failure.object_id, failure.condition) for failure in state.failures}
    assert failed == {
        ("broken", "clean"), ("broken", "m40"), ("broken", "sheet"), ("tower", "sheet")
    }  # fmt: skip
    assert not list((tmp_path / "twin").rglob("*.partial"))


def test_an_interrupted_run_leaves_whole_scans_only(tmp_path, meshes):
    root = tmp_path / "twin"

    def stop(now):
        if now.written:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(root, meshes, "clean", progress=stop)
    assert len(twin_scans(root)) == 1
    assert make(root, meshes, "clean") == (1, 1, 0)


def test_a_scan_interrupted_while_it_is_written_is_not_there(tmp_path, meshes, monkeypatch):
    def interrupt(*_arguments, **_more):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(trimesh.Trimesh, "export", interrupt)
        with pytest.raises(KeyboardInterrupt):
            make(tmp_path / "twin", meshes, "clean")
    assert twin_scans(tmp_path / "twin") == []
    assert list((tmp_path / "twin/clean").iterdir()) == []
    assert make(tmp_path / "twin", meshes, "clean") == (2, 0, 0)


def test_two_runs_do_not_meet(tmp_path, meshes):
    def second_run(_):
        with pytest.raises(StoreError, match="in use by process"):
            make(tmp_path / "twin", meshes, "clean")

    make(tmp_path / "twin", meshes, "clean", progress=second_run)


def test_workers_must_be_positive(tmp_path, meshes):
    with pytest.raises(RadarError, match="at least 1"):
        run_twin(
            tmp_path / "twin", find_objects([meshes]), resolve_conditions(["clean"]), SETTINGS, workers=0
        )


def test_the_reader_refuses_what_is_no_twin(tmp_path, meshes):
    with pytest.raises(StoreError, match=r"twin\.json is missing"):
        twin_scans(tmp_path)
    root = tmp_path / "twin"
    make(root, meshes, "clean")
    record = root / "clean/ball/truth.json"
    record.write_text("{")
    with pytest.raises(StoreError, match=r"truth\.json is damaged"):
        twin_scans(root)
    values = json.loads((root / "twin.json").read_text())
    for change, expected in (
        ({"version": 2}, "upgrade"),
        ({"format": "waveformer.image"}, "not a waveformer.twin"),
    ):
        (root / "twin.json").write_text(json.dumps({**values, **change}))
        with pytest.raises(StoreError, match=expected):
            twin_scans(root)


def test_difference_names_the_first_value():
    assert difference({"a": 1, "b": {"c": [1, 2]}}, {"a": 1, "b": {"c": [1, 2]}}) == ""
    assert difference({"a": 1, "b": {"c": 2}}, {"a": 1, "b": {"c": 3}}) == "b.c: 2, not 3"
    assert difference({"a": 1}, {}) == "a: 1, not null"
