"""Partials of a ball and a box against closed forms; what each setting keeps."""

import numpy as np
import pytest
import trimesh
from pydantic import ValidationError

from waveformer.datagen.farthest_points import farthest_points
from waveformer.datagen.partials import PartialSettings, draw_partial, view_of
from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.simulator import Aperture
from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.scene import build_scene

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

RADIUS_M, DEPTH_M = 0.05, 0.4
APERTURE = Aperture.planar_grid(31, 41, 0.01)


def fixed(tau, **changed):
    """One angle, without Eq. 3 and noise, and not thinned."""
    return PartialSettings(
        **{"tau_deg": (tau, tau), "reading": "none", "noise": None, "num_points": 1 << 20} | changed
    )


@pytest.fixture(scope="module")
def ball(mitsuba_variant):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(6000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    truth = TruthCloud(RADIUS_M * normals - [0, 0, DEPTH_M], normals)
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_M).apply_translation((0, 0, -DEPTH_M))
    return view_of(truth, APERTURE, build_scene([(mesh.vertices, mesh.faces)]), two_sided=False)


@pytest.fixture(scope="module")
def box(mitsuba_variant):
    mesh = load_mesh(trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((0, 0, -DEPTH_M)))
    scene = build_scene([(mesh.vertices_m, mesh.faces)])
    truth = sample_ground_truth(mesh, np.random.default_rng(0), 4000, scene=scene)
    return truth, scene


def test_a_centre_sensor_sees_a_cap(ball, rng):
    for tau in (15.0, 30.0):
        partial = draw_partial(ball, fixed(tau, aperture="centre"), rng)
        # Law of sines: at polar angle theta the angle to the sensor is theta + asin(radius sin theta / distance).
        polar = np.arccos(ball.normals[:, 2])
        expected = polar + np.arctan2(RADIUS_M * np.sin(polar), DEPTH_M - RADIUS_M * np.cos(polar))
        kept = np.flatnonzero(expected < np.deg2rad(tau))
        assert np.array_equal(np.sort(partial.index), kept)
        assert 20 < len(kept) < 1000


def test_eq_2_term_by_term(ball, rng):
    tau = 8.0
    partial = draw_partial(ball, fixed(tau), rng)
    kept = []
    for row, (point_m, normal) in enumerate(zip(ball.truth.points_m, ball.truth.normals, strict=True)):
        towards = APERTURE.tx_m - point_m
        cosine = (towards @ normal / np.linalg.norm(towards, axis=1)).max()
        if ball.visible[row] and np.rad2deg(np.arccos(min(1.0, cosine))) < tau:
            kept.append(row)
    assert sorted(partial.index.tolist()) == kept
    np.testing.assert_array_equal(partial.points_m, ball.truth.points_m[partial.index])
    assert partial.parameters["kept_points"] == len(kept)


def test_a_box_shows_its_lid(box, rng):
    truth, scene = box
    view = view_of(truth, APERTURE, scene, two_sided=False)
    partial = draw_partial(view, fixed(5.0), rng)
    assert (truth.normals[partial.index, 2] > 0.5).all()
    assert len(partial.index) == (truth.normals[:, 2] > 0.5).sum()


def test_the_literal_reading_removes_what_faces_the_radar(box, rng):
    truth, scene = box
    view = view_of(truth, APERTURE, scene, two_sided=False)
    near = {"tau_h_deg": (40.0, 40.0), "tau_v_deg": (40.0, 40.0)}
    lid = len(draw_partial(view, fixed(5.0), rng).index)
    assert len(draw_partial(view, fixed(5.0, reading="literal", **near), rng).index) == 0
    assert len(draw_partial(view, fixed(5.0, reading="tilt", **near), rng).index) == lid


def test_tilts_cut_a_ball(ball, rng):
    settings = fixed(180.0, reading="tilt", tau_h_deg=(10.0, 10.0), tau_v_deg=(20.0, 20.0))
    normals = ball.normals[draw_partial(ball, settings, rng).index]
    tilts = np.rad2deg(np.arctan2(np.abs(normals[:, :2]), normals[:, 2:]))
    # 6000 points lie about 1 degree apart.
    assert tilts[:, 0].max() == pytest.approx(10, abs=0.5)
    assert tilts[:, 1].max() == pytest.approx(20, abs=1.0)


def test_normals_that_point_either_way(box, rng):
    truth, scene = box
    mixed = TruthCloud(truth.points_m, truth.normals * rng.choice([-1.0, 1.0], (len(truth.points_m), 1)))
    expected = draw_partial(view_of(truth, APERTURE, scene, two_sided=False), fixed(5.0), rng)
    found = draw_partial(view_of(mixed, APERTURE, scene, two_sided=True), fixed(5.0), rng)
    assert np.array_equal(np.sort(found.index), np.sort(expected.index))


def test_hidden_point_removal_keeps_nearly_the_same(ball, rng):
    view = view_of(ball.truth, APERTURE, None, two_sided=False, visibility="hidden_point_removal")
    by_points, by_rays = (set(draw_partial(v, fixed(5.0), rng).index.tolist()) for v in (view, ball))
    # What mirrors back faces the radar: neither method loses more than single points of it.
    assert len(by_points ^ by_rays) < 0.03 * len(by_rays)


def test_more_points_are_thinned_evenly(ball, rng):
    kept = draw_partial(ball, fixed(20.0), rng)
    thin = draw_partial(ball, fixed(20.0, num_points=100), rng)
    assert thin.points_m.shape == (100, 3)
    rows = np.sort(kept.index)
    expected = rows[farthest_points(ball.truth.points_m[rows], 100)]
    assert np.array_equal(thin.index, expected)
    assert np.array_equal(kept.index[:100], expected)


def test_each_sample_draws_its_own_angles(ball):
    rng = np.random.default_rng(0)
    drawn = [draw_partial(ball, PartialSettings(noise=None), rng).parameters for _ in range(200)]
    for name, low, high in (("tau_deg", 2, 20), ("tau_h_deg", 10, 40), ("tau_v_deg", 10, 40)):
        values = np.array([one[name] for one in drawn])
        # The ends of 200 uniform draws lie within 4 % of the range, or once in 3500 times not.
        assert low <= values.min() < low + 0.04 * (high - low)
        assert high - 0.04 * (high - low) < values.max() <= high
    centre = [
        draw_partial(ball, PartialSettings(aperture="centre", noise=None), rng).parameters["tau_deg"]
        for _ in range(100)
    ]
    assert 15 <= min(centre) < 17
    assert 38 < max(centre) <= 40


def test_noise_changes_no_angle_and_marks_outliers(ball):
    clean, noisy = (
        draw_partial(ball, PartialSettings(**settings), np.random.default_rng(5))
        for settings in ({"noise": None}, {"noise": {"outlier_share": (0.1, 0.1)}})
    )
    assert noisy.parameters.pop("noise")["outlier_share"] == pytest.approx(0.1)
    assert noisy.parameters == clean.parameters
    same = noisy.index >= 0
    assert np.array_equal(noisy.index[same], clean.index[same])
    assert 0 < (~same).sum() < 0.3 * len(same)
    assert not np.array_equal(noisy.points_m[same], clean.points_m[same])


@pytest.mark.parametrize("seed", [0, 1])
def test_the_generator_decides(ball, seed):
    first, again = (
        draw_partial(ball, PartialSettings(), np.random.default_rng(seed)).points_m for _ in range(2)
    )
    np.testing.assert_array_equal(first, again)
    other = draw_partial(ball, PartialSettings(), np.random.default_rng(seed + 2)).points_m
    assert other.shape != first.shape or not np.array_equal(first, other)


def test_nothing_that_faces_the_radar_is_an_empty_partial(box, rng):
    truth, scene = box
    below = Aperture.planar_grid(3, 3, 0.01, center_m=(0.3, 0.3, -DEPTH_M + 0.3))
    view = view_of(truth, below, scene, two_sided=False)
    partial = draw_partial(view, PartialSettings(tau_deg=(2.0, 2.0)), rng)
    assert partial.points_m.shape == (0, 3)
    assert partial.index.shape == (0,)
    assert partial.parameters["kept_points"] == 0


def test_pairs_of_antennas_count_by_their_middle(ball, rng):
    apart = np.array([0.004, 0.0, 0.0])
    pairs = Aperture(APERTURE.tx_m - apart, APERTURE.tx_m + apart)
    view = view_of(ball.truth, pairs, None, two_sided=False, visibility="hidden_point_removal")
    np.testing.assert_allclose(view.angle_deg, ball.angle_deg, atol=1e-6)


def test_a_truth_without_normals_is_refused(ball):
    with pytest.raises(MeshError, match="no normals"):
        view_of(TruthCloud(ball.truth.points_m), APERTURE, None, two_sided=False)


@pytest.mark.parametrize(
    "wrong", [{"tau_deg": (5.0, 2.0)}, {"reading": "printed"}, {"num_points": 0}, {"tau": (1.0, 2.0)}]
)
def test_settings_are_checked(wrong):
    with pytest.raises(ValidationError):
        PartialSettings(**wrong)
