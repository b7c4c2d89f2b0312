"""Irregular division keeps the surface; leaving out hidden faces keeps the echo."""

import numpy as np
import pytest
import trimesh

from waveformer.datagen.twin_tessellation import antennas_to_test, divide_irregularly, without_hidden_faces
from waveformer.simulator.forward_model import ForwardModel
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.numerics import EXACT
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.target import Target

CHIRP = Chirp(77.5001e9, 3.0009e9, 8)
APERTURE = Aperture.planar_grid(6, 5, 0.004)
COARSE = EXACT.model_copy(update={"spacing_wavelengths": 0.5, "tolerance": 1e-4})


def test_division_keeps_the_surface(rng):
    mesh = load_mesh(trimesh.creation.icosphere(subdivisions=1, radius=0.02))
    divided = divide_irregularly(mesh, 2, rng)
    assert len(divided.faces) == 16 * len(mesh.faces)
    # pieces of a face lie in its plane, with its normal, and fill it
    assert divided.normals.reshape(-1, 16, 3) == pytest.approx(
        np.repeat(mesh.normals[:, None], 16, axis=1), abs=1e-12
    )
    assert divided.areas_m2.reshape(-1, 16).sum(axis=1) == pytest.approx(mesh.areas_m2, rel=1e-12)
    body = trimesh.Trimesh(divided.vertices_m, divided.faces, process=False)
    assert body.is_watertight
    assert body.is_winding_consistent


def test_division_is_irregular_and_seeded():
    mesh = load_mesh(trimesh.creation.box((0.02, 0.03, 0.04)))
    first, same, other = (divide_irregularly(mesh, 1, np.random.default_rng(seed)) for seed in (0, 0, 1))
    assert (first.vertices_m == same.vertices_m).all()
    assert (first.vertices_m != other.vertices_m).any()
    middles = 0.5 * (mesh.triangles_m + np.roll(mesh.triangles_m, -1, axis=1)).reshape(-1, 3)
    added = first.vertices_m[len(mesh.vertices_m) :]
    away_m = np.linalg.norm(added[:, None] - middles[None], axis=2).min(axis=1)
    assert np.median(away_m) > 0.5e-3
    # at most 0.15 of the longest edge, the diagonal of the largest side, 5 cm
    assert away_m.max() < 0.15 * 0.05


def test_no_division(rng):
    mesh = load_mesh(trimesh.creation.box((0.02, 0.03, 0.04)))
    assert divide_irregularly(mesh, 0, rng) is mesh


def model_of(*bodies):
    meshes = [body.copy().apply_translation((0, 0, -0.3)) for body in bodies]
    return ForwardModel.prepare([Target(mesh) for mesh in meshes], CHIRP, APERTURE, mode=COARSE)


def test_hidden_faces_go_and_the_echo_stays(mitsuba_variant):
    # an open box reflects on both sides, so that its inside and the ball in it are hidden by rays only
    shell = trimesh.creation.box((0.03, 0.03, 0.03)).subdivide().subdivide().subdivide()
    shell.update_faces(np.arange(len(shell.faces)) != shell.triangles_center[:, 2].argmin())
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.01)
    model = model_of(shell, ball)
    assert model.placed[0].mesh.two_sided
    reduced = without_hidden_faces(model)
    # the antennas, within 10 mm of the axis, see the upper one of the box's six sides; the faces that touch it stay too
    upper = len(shell.faces) // 6 + 1
    assert 1.3 * upper < len(reduced.placed[0].mesh.faces) < 2 * upper
    assert len(reduced.placed[1].mesh.faces) == 0
    whole = model.echo(APERTURE)
    # exactly the pieces that no antenna sees are gone; single precision sums the rest in another order
    assert np.linalg.norm(reduced.echo(APERTURE) - whole) < 1e-5 * np.linalg.norm(whole)
    assert np.linalg.norm(whole) > 0


def test_a_face_that_is_seen_in_part_is_kept(mitsuba_variant):
    # both centroids of the plate's two faces lie in the shadow of the block
    plate = trimesh.Trimesh(
        [[-0.03, -0.03, 0], [0.03, -0.03, 0], [0.03, 0.03, 0], [-0.03, 0.03, 0]], [[0, 1, 2], [0, 2, 3]]
    )
    block = trimesh.creation.box((0.05, 0.05, 0.004)).apply_translation((0, 0, 0.01))
    reduced = without_hidden_faces(model_of(plate, block))
    assert len(reduced.placed[0].mesh.faces) == 2


def test_tested_antennas_cover_the_aperture():
    aperture = Aperture.planar_grid(76, 101, 0.004)
    positions = antennas_to_test(aperture)
    assert 200 < len(positions) < 500
    for reduce in (np.min, np.max):
        assert reduce(positions, axis=0) == pytest.approx(reduce(aperture.tx_m, axis=0))
    assert len(antennas_to_test(APERTURE)) == len(APERTURE)
