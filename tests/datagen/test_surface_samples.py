"""Ground truth lies evenly on the outer surface and nowhere else."""

import numpy as np
import pytest
import trimesh

from waveformer.datagen.surface_samples import NUM_POINTS, sample_ground_truth
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.scene import build_scene

pytestmark = pytest.mark.usefixtures("mitsuba_variant")


def ball(radius_m, subdivisions=3):
    return trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m)


def test_a_box_keeps_all_its_area(rng):
    sides_m = np.array([0.2, 0.1, 0.05])
    truth = sample_ground_truth(load_mesh(trimesh.creation.box(sides_m)), rng)
    assert truth.points_m.shape == truth.normals.shape == (NUM_POINTS, 3)
    distance_m = np.abs(np.abs(truth.points_m) - sides_m / 2)
    assert distance_m.min(axis=1).max() < 1e-15
    for axis in range(3):
        area = np.prod(np.delete(sides_m, axis)) / (sides_m[[0, 1, 0]] * sides_m[[1, 2, 2]]).sum() / 2
        for side in (-1, 1):
            # 4.5 standard deviations of the binomial count.
            share = (truth.normals[:, axis] * side > 0.5).mean()
            assert share == pytest.approx(area, abs=4.5 * np.sqrt(area / NUM_POINTS))


def test_points_are_uniform_inside_a_triangle(rng):
    triangle = trimesh.Trimesh([(0, 0, 0), (0.3, 0, 0), (0, 0.3, 0)], [(0, 1, 2)], process=False)
    points = sample_ground_truth(load_mesh(triangle), rng, 20_000).points_m / 0.3
    # Mean 1/3 and variance 1/18 of a coordinate; 4.5 standard errors.
    assert points[:, :2].mean(axis=0) == pytest.approx([1 / 3] * 2, abs=4.5 * np.sqrt(1 / 18 / 20_000))
    assert points[:, :2].var(axis=0) == pytest.approx([1 / 18] * 2, abs=0.0025)


def test_an_inner_shell_is_left_out(rng):
    outer, inner = ball(0.05), ball(0.04)
    truth = sample_ground_truth(load_mesh(outer + inner), rng, 2000)
    assert np.linalg.norm(truth.points_m, axis=1).min() > 0.048


def test_a_lost_triangle_does_not_open_the_hull(rng):
    outer = ball(0.05, subdivisions=4)
    outer.update_faces(np.arange(len(outer.faces)) != 7)
    truth = sample_ground_truth(load_mesh(outer + ball(0.03)), rng, 2000)
    assert np.linalg.norm(truth.points_m, axis=1).min() > 0.049


def test_a_cup_keeps_its_inside(rng):
    # As deep and narrow as a pitcher, walls 3 mm thick.
    outer = trimesh.creation.cylinder(radius=0.053, height=0.233)
    inner = trimesh.creation.cylinder(radius=0.05, height=0.233).apply_translation((0, 0, 0.003))
    keep = inner.triangles_center[:, 2] < 0.1195 - 1e-6
    inner.update_faces(keep)
    inner.invert()
    lidless = outer.triangles_center[:, 2] < 0.1165 - 1e-6
    outer.update_faces(lidless)
    truth = sample_ground_truth(load_mesh(outer + inner), rng, 4000)
    on_bottom = (np.abs(truth.points_m[:, 2] + 0.1135) < 1e-6) & (truth.normals[:, 2] > 0.5)
    bottom = np.pi * 0.05**2
    area_m2 = 2 * bottom + 2 * np.pi * (0.05 + 0.053) * 0.23
    assert on_bottom.mean() == pytest.approx(bottom / area_m2, rel=0.25)


def test_a_sheet_is_seen_from_both_sides(rng):
    sheet = trimesh.Trimesh([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], [(0, 2, 1)], process=False)
    assert len(sample_ground_truth(load_mesh(sheet), rng, 100).points_m) == 100


def test_the_seed_decides():
    box = load_mesh(trimesh.creation.box((0.1, 0.1, 0.1)))
    first, again, other = (
        sample_ground_truth(box, np.random.default_rng(seed), 100).points_m for seed in (0, 0, 1)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_hull_around_nearly_everything_is_refused(rng):
    nested = trimesh.util.concatenate([ball(radius_m, 1) for radius_m in np.linspace(0.03, 0.1, 300)])
    with pytest.raises(MeshError, match="seen from outside") as refusal:
        sample_ground_truth(load_mesh(nested), rng, 300)
    assert refusal.value.code == "mesh.no_outer_surface"


def test_a_scene_that_is_there_already_changes_nothing():
    mesh = load_mesh(ball(0.05))
    scene = build_scene([(mesh.vertices_m, mesh.faces)])
    own, given = (
        sample_ground_truth(mesh, np.random.default_rng(0), 100, scene=known).points_m
        for known in (None, scene)
    )
    assert np.array_equal(own, given)
