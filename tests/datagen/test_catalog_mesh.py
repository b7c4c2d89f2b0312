"""Frames, refusals and the hash of a shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from waveformer.datagen.catalog_mesh import geometry_sha256, load_placed
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import load_mesh


def shape() -> trimesh.Trimesh:
    """A closed body without any symmetry, 1 x 0.5 x 0.25."""
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    mesh.vertices[mesh.vertices[:, 0] > 0.3] *= [1, 0.6, 0.9]
    mesh.vertices *= [1.0, 0.5, 0.25] / mesh.extents
    return mesh


def save(folder: Path, mesh: trimesh.Trimesh, name: str = "a.ply") -> Path:
    mesh.export(folder / name)
    return folder / name


@pytest.mark.parametrize(
    ("up_axis", "sides"), [("z", (1.0, 0.5, 0.25)), ("y", (1.0, 0.25, 0.5)), ("x", (0.25, 0.5, 1.0))]
)
def test_the_up_axis_becomes_z_and_the_body_is_turned_not_mirrored(tmp_path, up_axis, sides):
    mesh = load_placed(save(tmp_path, shape().apply_translation([3, 4, 5])), 1.0, up_axis)
    np.testing.assert_allclose(mesh.extent_m, sides, rtol=1e-6)
    # float32 in the file, 5 units from the origin: 5e-7.
    np.testing.assert_allclose(mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0), 0, atol=1e-12)
    assert not mesh.two_sided
    volume = np.einsum(
        "fi,fi->", mesh.triangles_m[:, 0], np.cross(mesh.triangles_m[:, 1], mesh.triangles_m[:, 2])
    )
    assert volume > 0


def test_y_up_turns_as_the_collections_say(tmp_path):
    mesh = shape()
    placed = load_placed(save(tmp_path, mesh), 1.0, "y")
    x, y, z = (mesh.vertices - mesh.bounds.mean(axis=0)).T
    np.testing.assert_allclose(placed.vertices_m, np.stack([x, -z, y], axis=1), atol=1e-6)


@pytest.mark.parametrize("factor", [1e-3, 1.0, 250.0, 1e6])
def test_an_unknown_unit_makes_the_longest_side_one(tmp_path, factor):
    mesh = load_placed(save(tmp_path, shape().apply_scale(factor)), None, "z")
    assert mesh.extent_m.max() == pytest.approx(1.0)


def test_a_known_unit_is_used(tmp_path):
    assert load_placed(save(tmp_path, shape()), 0.2, "z").extent_m.max() == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("scale", "unit_m", "code"),
    [
        ((1, 1, 0), None, "mesh.flat"),
        ((1, 1e-3, 1e-3), None, "mesh.thin"),
        ((1e12, 1e12, 1e12), None, "mesh.too_large"),
        ((1e-9, 1e-9, 1e-9), None, "mesh.too_small"),
        ((1000, 1000, 1000), 1.0, "mesh.too_large"),
        ((0, 0, 0), None, "mesh.zero_area"),
    ],
)
def test_what_is_no_body_is_refused(tmp_path, scale, unit_m, code):
    mesh = shape()
    mesh.vertices = mesh.vertices * scale
    with pytest.raises(MeshError) as caught:
        load_placed(save(tmp_path, mesh), unit_m, "z")
    assert caught.value.code == code
    assert "a.ply" in str(caught.value)


def test_a_body_turned_inside_out_is_repaired_and_noted(tmp_path):
    mesh = shape()
    mesh.invert()
    placed = load_placed(save(tmp_path, mesh), None, "z")
    assert placed.problems == ("flipped 1 of 1 bodies that were turned inside out",)
    assert geometry_sha256(placed) == geometry_sha256(load_mesh(shape()))


def test_copies_have_one_hash(tmp_path, rng):
    expected = geometry_sha256(load_mesh(shape()))
    vertices, faces = shape().vertices, shape().faces
    order = rng.permutation(len(vertices))
    shuffled = trimesh.Trimesh(
        vertices[order], np.argsort(order)[faces][rng.permutation(len(faces))], process=False
    )
    rolled = trimesh.Trimesh(vertices, np.roll(faces, 1, axis=1), process=False)
    moved = shape().apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    copies = [shuffled, rolled, moved.apply_translation([1, 2, 3]), shape().apply_scale(0.037)]
    assert [geometry_sha256(load_mesh(copy)) for copy in copies] == [expected] * len(copies)
    for name in ("a.stl", "a.ply", "a.obj", "a.off", "a.glb"):
        assert geometry_sha256(load_placed(save(tmp_path, shape(), name), None, "z")) == expected, name


def test_other_shapes_have_other_hashes():
    changed = [shape().vertices, *(shape().vertices * scale for scale in np.eye(3) * 0.01 + 1)]
    changed.append(shape().vertices + [[0.02, 0, 0]] * (np.arange(len(shape().vertices)) < 5)[:, None])
    hashes = {
        geometry_sha256(load_mesh(trimesh.Trimesh(points, shape().faces, process=False)))
        for points in changed
    }
    assert len(hashes) == len(changed)
    assert geometry_sha256(load_mesh(shape().subdivide())) not in hashes


def test_rounding_seldom_hides_a_copy(rng):
    """Coordinates of six digits change the hash about once in a hundred."""
    missed = 0
    for _ in range(100):
        mesh = shape()
        mesh.vertices *= rng.uniform(0.5, 1.0, 3)
        rounded = trimesh.Trimesh(mesh.vertices.round(6), mesh.faces, process=False)
        missed += geometry_sha256(load_mesh(mesh)) != geometry_sha256(load_mesh(rounded))
    assert missed <= 3
