"""The noise of partials: its sizes and directions, and that a wrong level is a surface at equal distance."""

import numpy as np
import pytest
from pydantic import ValidationError

from waveformer.datagen.partial_noise import (
    LEVEL_STEP_M,
    PartialNoise,
    add_noise,
    correlated_field,
    smoothed_normals,
)
from waveformer.datagen.truth_cloud import TruthCloud

RADIUS_M = 0.05
QUIET = {
    "sigma_radii": (0.0, 0.0),
    "outlier_share": (0.0, 0.0),
    "depth_shift_m": 0.0,
    "wrong_level_probability": 0.0,
}
ORIGIN = np.zeros(3)


@pytest.fixture
def ball(rng):
    normals = rng.normal(size=(20_000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return TruthCloud(RADIUS_M * normals - [0, 0, 0.4], normals)


def noisy(ball, rng, **changed):
    return add_noise(ball.points_m, ball.normals, ball, ORIGIN, PartialNoise(**QUIET | changed), rng)


def test_without_noise_nothing_moves(ball, rng):
    found = noisy(ball, rng)
    np.testing.assert_array_equal(found.points_m, ball.points_m)
    assert not found.is_outlier.any()


def test_the_size_and_its_share_along_the_range(ball, rng):
    sigma_m = 0.03 * ball.radius_m
    squares = []
    for _ in range(20):
        found = noisy(ball, rng, sigma_radii=(0.03, 0.03), correlation_m=(0.002, 0.002))
        moved = found.points_m - ball.points_m
        away = ball.points_m / np.linalg.norm(ball.points_m, axis=1, keepdims=True)
        along = np.einsum("pi,pi->p", moved, away)
        squares.append([(moved**2).sum(axis=1).mean(), (along**2).mean()])
    total, along = np.mean(squares, axis=0) / sigma_m**2
    # A ball has about 2000 places 2 mm apart: 3 % a sample of the correlated part, 20 samples.
    assert total == pytest.approx(1.0, rel=0.03)
    # Half correlated, and a third of the isotropic half.
    assert along == pytest.approx(1 / 2 + 1 / 6, rel=0.04)


@pytest.mark.parametrize("length_m", [0.002, 0.006])
def test_covariance_of_the_field(rng, length_m):
    # Pairs at set distances, far apart from each other, and many fields.
    distance_m = np.array([0.0, 0.5, 1.0, 2.0, 4.0]) * length_m
    points_m = np.stack([distance_m, 0 * distance_m, 0 * distance_m], axis=1)
    values = np.array([correlated_field(points_m, length_m, rng) for _ in range(4000)])
    covariance = (values * values[:, :1]).mean(axis=0)
    # 4000 products of unit variance 1 .. 2: 0.022 each, 4 sigma.
    np.testing.assert_allclose(covariance, np.exp(-(distance_m**2) / (2 * length_m**2)), atol=0.09)
    assert np.std(correlated_field(rng.normal(size=(5000, 3)), 0.0, rng)) == pytest.approx(1, abs=0.05)


def test_a_depth_shift_is_the_same_for_all(ball, rng):
    few = TruthCloud(ball.points_m[:20], ball.normals[:20])
    shifts = []
    for _ in range(400):
        found = noisy(few, rng, depth_shift_m=0.002)
        moved = np.linalg.norm(found.points_m, axis=1) - np.linalg.norm(few.points_m, axis=1)
        assert np.ptp(moved) < 1e-12
        assert moved[0] == pytest.approx(found.parameters["depth_shift_m"])
        shifts.append(moved[0])
    # 4.5 standard errors of a standard deviation, sd / sqrt(2 n).
    assert np.std(shifts) == pytest.approx(0.002, rel=4.5 / np.sqrt(800))


def test_outliers_lie_in_the_imaged_box(ball, rng):
    found = noisy(ball, rng, outlier_share=(0.1, 0.1))
    assert found.is_outlier.mean() == pytest.approx(0.1, abs=4.5 * np.sqrt(0.09 / 20_000))
    np.testing.assert_array_equal(found.points_m[~found.is_outlier], ball.points_m[~found.is_outlier])
    out = found.points_m[found.is_outlier] + [0, 0, 0.4]
    assert RADIUS_M < np.abs(out).max() <= RADIUS_M + 0.03


def test_a_wrong_level_of_a_ball_is_a_ball(ball, rng):
    few = TruthCloud(ball.points_m[:3000], ball.normals[:3000])
    steps = set()
    for _ in range(60):
        found = noisy(few, rng, wrong_level_probability=1.0, wrong_level_steps=(2, 4))
        steps.add(found.parameters["level_steps"])
        radius_m = np.linalg.norm(found.points_m + [0, 0, 0.4], axis=1)
        expected_m = RADIUS_M + found.parameters["level_steps"] * LEVEL_STEP_M
        # Twelve neighbours lie within 7 degrees or so: their mean is off by a few, and 8 mm by (1 - cos) of that.
        np.testing.assert_allclose(radius_m, expected_m, atol=1e-4)
    assert steps == {-4, -3, -2, 2, 3, 4}


def test_how_often_a_level_is_wrong(ball, rng):
    few = TruthCloud(ball.points_m[:10], ball.normals[:10])
    steps = [noisy(few, rng, wrong_level_probability=0.3).parameters["level_steps"] for _ in range(1000)]
    assert np.mean(np.array(steps) != 0) == pytest.approx(0.3, abs=4.5 * np.sqrt(0.21 / 1000))


def test_rough_normals_are_smoothed(ball, rng):
    rough = ball.normals + 0.3 * rng.normal(size=ball.normals.shape)
    rough /= np.linalg.norm(rough, axis=1, keepdims=True)
    smooth = smoothed_normals(ball.points_m, rough)
    before, after = (np.einsum("pi,pi->p", n, ball.normals).mean() for n in (rough, smooth))
    assert 1 - after < (1 - before) / 8  # averages of 12
    np.testing.assert_allclose(smoothed_normals(ball.points_m[:1], rough[:1]), rough[:1], rtol=1e-15)
    apart = np.array([[0, 0, 1.0], [0, 0, -1.0]])
    np.testing.assert_array_equal(smoothed_normals(ball.points_m[:2], apart), apart)


def test_the_generator_decides(ball):
    first, again, other = (
        noisy(ball, np.random.default_rng(seed), sigma_radii=(0.01, 0.05)).points_m for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_parameters_do_not_depend_on_the_number_of_points(ball):
    all_points, few, none = (
        add_noise(
            ball.points_m[:count], ball.normals[:count], ball, ORIGIN,
            PartialNoise(wrong_level_probability=1.0), np.random.default_rng(0),
        )
        for count in (None, 5, 0)
    )  # fmt: skip
    assert all_points.parameters == few.parameters == none.parameters
    assert none.points_m.shape == (0, 3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"sigma_radii": (0.05, 0.01)},
        {"outlier_share": (0.0, 1.5)},
        {"wrong_level_steps": (0, 3)},
        {"depth_shift_m": -1.0},
        {"depth_shift_m": np.inf},
        {"sigma": 1.0},
    ],
)
def test_ranges_are_checked(wrong):
    with pytest.raises(ValidationError):
        PartialNoise(**wrong)
