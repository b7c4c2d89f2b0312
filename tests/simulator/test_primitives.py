"""Meshes built in code: closed where they should be, of the right size, and fine enough."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh

from waveformer.simulator import primitives
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import load_mesh

CLOSED = {
    "sphere": lambda edge_m: primitives.sphere(0.03, edge_m),
    "cylinder": lambda edge_m: primitives.cylinder(0.03, 0.1, edge_m),
    "box": lambda edge_m: primitives.box(0.05, 0.03, 0.02, edge_m),
    "mug": lambda edge_m: primitives.mug(edge_m),
    "hammer": lambda edge_m: primitives.hammer(edge_m),
    "hammer_head": lambda edge_m: primitives.hammer_head(edge_m),
    "hammer_handle": lambda edge_m: primitives.hammer_handle(edge_m),
}
OPEN = {
    "plate": lambda edge_m: primitives.plate(0.05, 0.03, edge_m),
    "disc": lambda edge_m: primitives.disc(0.03, edge_m),
}


@pytest.mark.parametrize("edge_m", [1.5e-3, 4e-3])
@pytest.mark.parametrize("name", CLOSED)
def test_closed_shapes_are_watertight_with_outward_normals(name: str, edge_m: float) -> None:
    shape = CLOSED[name](edge_m)
    assert shape.is_watertight
    assert shape.is_winding_consistent
    assert all(body.volume > 0 for body in shape.split())
    mesh = load_mesh(shape)
    assert not mesh.two_sided
    assert mesh.problems == ()


@pytest.mark.parametrize("edge_m", [1.5e-3, 4e-3])
@pytest.mark.parametrize("name", CLOSED | OPEN)
def test_no_edge_is_longer_than_asked(name: str, edge_m: float) -> None:
    shape = (CLOSED | OPEN)[name](edge_m)
    assert shape.edges_unique_length.max() <= edge_m
    # ... and not needlessly short either: no more faces than 8 times the equilateral minimum.
    if name != "disc":  # its rim is fine on purpose
        assert len(shape.faces) < 8 * shape.area / (math.sqrt(3) / 4 * edge_m**2)


@pytest.mark.parametrize("name", OPEN)
def test_open_sheets_face_up(name: str) -> None:
    shape = OPEN[name](2e-3)
    assert np.allclose(shape.face_normals, [0, 0, 1])
    assert np.ptp(shape.vertices[:, 2]) == 0
    # One sheet: every edge belongs to two faces but for those of the rim, which is one closed line.
    assert shape.euler_number == 1
    assert load_mesh(shape).two_sided


def test_sphere() -> None:
    sphere = primitives.sphere(0.05, 2e-3)
    assert np.linalg.norm(sphere.vertices, axis=1) == pytest.approx(0.05, rel=1e-12)
    assert sphere.area == pytest.approx(4 * math.pi * 0.05**2, rel=3e-4)
    assert sphere.volume == pytest.approx(4 / 3 * math.pi * 0.05**3, rel=3e-4)
    assert len(primitives.sphere(0.05, 1.0).faces) == 20


def test_plate() -> None:
    plate = primitives.plate(0.1, 0.2, 5e-3, center_m=(1, 2, 3))
    assert plate.area == pytest.approx(0.02, rel=1e-12)
    assert plate.bounds == pytest.approx(np.array([[0.95, 1.9, 3], [1.05, 2.1, 3]]))
    assert len(primitives.plate(0.1, 0.2).faces) == 2


@pytest.mark.parametrize("edge_m", [math.inf, 0.02, 2e-3])
def test_disc_has_the_area_of_the_circle_at_every_edge(edge_m: float) -> None:
    disc = primitives.disc(0.05, edge_m)
    assert disc.area == pytest.approx(math.pi * 0.05**2, rel=1e-12)
    radius_m = np.linalg.norm(disc.vertices, axis=1).max()
    assert radius_m == pytest.approx(0.05, rel=1e-5)
    # Area is where it belongs: also the second moment is that of the circle.
    moment = (trimesh.triangles.area(disc.triangles) * (disc.triangles_center**2).sum(axis=1)).sum()
    corners = disc.triangles - disc.triangles_center[:, None]
    moment += (disc.area_faces * (corners**2).sum(axis=(1, 2)) / 12).sum()
    assert moment == pytest.approx(math.pi * 0.05**4 / 2, rel=1e-4)


def test_cylinder() -> None:
    cylinder = primitives.cylinder(0.03, 0.1)
    assert cylinder.volume == pytest.approx(math.pi * 0.03**2 * 0.1, rel=3e-4)
    assert cylinder.area == pytest.approx(2 * math.pi * 0.03 * 0.13, rel=3e-4)
    assert cylinder.bounds == pytest.approx(np.array([[-0.03, -0.03, -0.05], [0.03, 0.03, 0.05]]), abs=1e-5)
    centers = cylinder.triangles_center
    outward = np.where(np.abs(centers[:, 2:]) > 0.05 - 1e-9, centers * [0, 0, 1], centers * [1, 1, 0])
    cosine = np.einsum("ij,ij->i", cylinder.face_normals, outward) / np.linalg.norm(outward, axis=1)
    assert cosine.min() > 0.999


def test_box() -> None:
    box = primitives.box(0.1, 0.2, 0.3, center_m=(1, 0, 0))
    assert len(box.faces) == 12
    assert box.volume == pytest.approx(0.006)
    assert box.bounds == pytest.approx(np.array([[0.95, -0.1, -0.15], [1.05, 0.1, 0.15]]))
    assert primitives.box(0.1, 0.2, 0.3, 0.01).area == pytest.approx(0.22)


def test_mug_is_hollow_and_open_at_the_top() -> None:
    mug = primitives.mug()
    assert mug.extents == pytest.approx([0.109, 0.08, 0.09], abs=5e-4)
    assert mug.bounds[0, 2] == 0
    cup, handle = sorted(mug.split(), key=lambda body: -body.volume)
    # Between a tube with a base and its rounded edges: pi (R^2 H - r^2 (H - wall)).
    tube = math.pi * (0.04**2 * 0.09 - 0.036**2 * 0.086)
    assert cup.volume == pytest.approx(tube, rel=0.02)
    # The floor lies one wall thickness above the table, and nothing is above it.
    axis = cup.vertices[np.linalg.norm(cup.vertices[:, :2], axis=1) < 1e-9]
    assert sorted(axis[:, 2]) == pytest.approx([0, 0.004])
    # The handle's ends lie within the wall: overlapping it, yet not coming out inside the cup.
    radius_m = np.linalg.norm(handle.vertices[:, :2], axis=1)
    assert 0.036 < radius_m.min() < 0.039
    with pytest.raises(MeshError, match="wall"):
        primitives.mug(wall_m=0.03)


def test_hammer_has_everyday_size_and_its_parts_overlap() -> None:
    hammer = primitives.hammer()
    assert hammer.extents == pytest.approx([0.3, 0.1, 0.032], abs=1e-3)
    head, handle = primitives.hammer_head(), primitives.hammer_handle()
    assert len(hammer.faces) == len(head.faces) + len(handle.faces)
    assert head.extents[1] == pytest.approx(0.1)
    assert handle.bounds[0, 0] < head.bounds[0, 0] < 0 < head.bounds[1, 0] < handle.bounds[1, 0]


@pytest.mark.parametrize(
    "build",
    [
        lambda: primitives.sphere(0, 1e-3),
        lambda: primitives.plate(0.1, -1),
        lambda: primitives.disc(math.nan),
        lambda: primitives.cylinder(0.1, 0.1, 0),
        lambda: primitives.box(0.1, 0.1, 0),
    ],
)
def test_sizes_must_be_positive(build) -> None:
    with pytest.raises(MeshError, match="must be a positive number of metres"):
        build()
