"""3-D pictures: the same layers through VTK, through matplotlib, and in a browser."""

import re

import matplotlib.image
import numpy as np
import pytest
import trimesh

from waveformer.eval import viewer
from waveformer.eval.scene import MAX_FACES, MAX_POINTS, isosurface, load_layers, save_layers, scene_layers
from waveformer.simulator.grid import Grid
from waveformer.simulator.image import Image
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.radar import Aperture


def gaussian_blob(center_m=(0.01, 0.0, -0.4), radius_m=0.02) -> Image:
    grid = Grid.box((-0.06, -0.06, -0.46), (0.06, 0.06, -0.34), 0.004)
    points = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1)
    # -6 dB (half the magnitude, to 0.3 %) at the radius.
    distance_m = np.linalg.norm(points - center_m, axis=-1)
    return Image((0.5 ** ((distance_m / radius_m) ** 2)).astype(np.complex64), grid)


@pytest.fixture(scope="module")
def layers():
    ball = load_mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.03).apply_translation((0, 0, -0.4)))
    return scene_layers(meshes=[ball], aperture=Aperture.planar_grid(90, 90, 0.002), image=gaussian_blob())


def is_drawn(path) -> bool:
    picture = matplotlib.image.imread(path)[..., :3]
    # Grey mesh, blue antennas and orange image: there is colour, and it is not one colour.
    return bool(np.ptp(picture, axis=-1).max() > 0.5 and picture.std() > 0.02)


def test_layers(layers):
    names = [layer.name for layer in layers]
    assert names[1:] == ["antenna positions", "image at -6 dB of its peak", "image at -12 dB of its peak"]
    assert names[0].startswith("mesh ")
    assert 0 < len(layers[1].vertices_m) <= MAX_POINTS
    assert np.ptp(layers[1].vertices_m, axis=0) == pytest.approx([0.178, 0.178, 0.0], abs=0.01)


def test_isosurface_lies_where_the_level_is():
    vertices_m, faces = isosurface(gaussian_blob(), -6.0206)
    distance_m = np.linalg.norm(vertices_m - [0.01, 0.0, -0.4], axis=1)
    # Linear interpolation between voxels of 4 mm on a slope of 35 per metre.
    assert distance_m == pytest.approx(np.full(len(distance_m), 0.02), abs=5e-4)
    assert faces.max() == len(vertices_m) - 1


def test_flat_and_empty_images_have_no_surface():
    flat = Grid(np.arange(4.0), np.arange(4.0), np.array([0.0]))
    assert scene_layers(image=Image(np.ones(flat.shape, np.complex64), flat)) == []
    full = Grid(np.arange(4.0), np.arange(4.0), np.arange(4.0))
    assert scene_layers(image=Image(np.zeros(full.shape, np.complex64), full)) == []


def test_big_meshes_are_thinned():
    ball = load_mesh(trimesh.creation.icosphere(subdivisions=7, radius=0.1))
    assert len(ball.faces) > MAX_FACES
    (layer,) = scene_layers(meshes=[ball])
    assert 0.5 * MAX_FACES < len(layer.faces) <= MAX_FACES
    assert np.linalg.norm(layer.vertices_m, axis=1) == pytest.approx(
        np.full(len(layer.vertices_m), 0.1), rel=0.01
    )


def test_layers_travel_through_a_file(tmp_path, layers):
    save_layers(layers, tmp_path / "scene.npz")
    for loaded, saved in zip(load_layers(tmp_path / "scene.npz"), layers, strict=True):
        assert (loaded.name, loaded.color, loaded.opacity) == (saved.name, saved.color, saved.opacity)
        np.testing.assert_array_equal(loaded.vertices_m, saved.vertices_m)
        np.testing.assert_array_equal(loaded.faces, saved.faces)


def test_png_by_vtk(tmp_path, layers):
    reason = viewer.render_png(layers, tmp_path / "scene.png")
    assert is_drawn(tmp_path / "scene.png")
    if reason is not None:
        pytest.skip(f"no working OpenGL here: {reason}")


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "ended by signal 11"),
        ("raise SystemExit('no display')", "VTK failed: no display"),
        ("pass", "VTK failed: exit code 0"),
        ("import time; time.sleep(30)", "did not finish"),
    ],
)
def test_png_by_matplotlib_when_the_child_fails(tmp_path, monkeypatch, layers, code, expected):
    (tmp_path / "broken_child.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(viewer, "_CHILD_MODULE", "broken_child")
    monkeypatch.setattr(viewer, "_CHILD_TIMEOUT_S", 3)
    reason = viewer.render_png(layers, tmp_path / "scene.png")
    assert reason is not None
    assert expected in reason
    assert is_drawn(tmp_path / "scene.png")


def test_html_is_one_self_contained_file(tmp_path, layers):
    viewer.export_html(layers, tmp_path / "scene.html")
    page = (tmp_path / "scene.html").read_text(encoding="utf-8")
    for layer in layers:
        assert layer.name in page
    # Nothing is named as a source, and the policy, which must precede all scripts, forbids the rest.
    assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page.replace("\\", ""))
    assert "default-src 'none'" in page[: page.index("<script")]


def test_a_box_is_its_twelve_edges():
    corners = np.array([[-0.1, -0.05, -0.5], [0.1, 0.05, -0.3]])
    (layer,) = scene_layers(box_m=corners)
    assert layer.name == "box"
    on_faces = (layer.vertices_m[:, None] == corners).any(axis=1).sum(axis=1)
    assert (on_faces >= 2).all()
    # 4 * (0.2 + 0.1 + 0.2) m of edges in steps of 2 mm, and a point more on each of them
    assert len(layer.vertices_m) == 4 * (100 + 50 + 100 + 3)
    assert np.array_equal([layer.vertices_m.min(axis=0), layer.vertices_m.max(axis=0)], corners)
