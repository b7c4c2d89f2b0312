"""Metrics against brute force, closed forms and their invariances."""

from dataclasses import astuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.eval.metrics import (
    MAX_POINTS,
    REPORTED_THRESHOLDS,
    ThresholdScore,
    coverage,
    score_reconstruction,
)
from waveformer.simulator.errors import MeshError, RadarError


def sphere(count):
    """Evenly spread points of the unit sphere."""
    height = 1 - (2 * np.arange(count) + 1) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


def brute_force_distances(prediction, truth):
    """Nearest-neighbour distances both ways in radii, from all pairs."""
    center = truth.mean(axis=0)
    radius = np.sqrt(((truth - center) ** 2).sum(axis=1)).max()
    pairs = np.sqrt(((prediction[:, None] - truth[None]) ** 2).sum(axis=2)) / radius
    return pairs.min(axis=1), pairs.min(axis=0)


def test_against_all_pairs(rng):
    truth, prediction = rng.normal(size=(300, 3)) + 5, rng.normal(size=(200, 3)) * 0.9 + 5.1
    score = score_reconstruction(prediction, TruthCloud(truth), threshold=0.1)
    to_truth, to_prediction = brute_force_distances(prediction, truth)
    assert score.precision == (to_truth < 0.1).mean()
    assert score.recall == (to_prediction < 0.1).mean()
    mean = (to_truth.mean() + to_prediction.mean()) / 2
    assert score.chamfer == pytest.approx(mean, rel=1e-12)
    squared = (to_truth**2).mean() + (to_prediction**2).mean()
    assert astuple(score.chamfer_distances) == pytest.approx((mean, 2 * mean, squared), rel=1e-12)
    assert [entry.threshold for entry in score.by_threshold] == list(REPORTED_THRESHOLDS)
    for entry in score.by_threshold:
        assert entry.precision == (to_truth < entry.threshold).mean()
        assert entry.recall == (to_prediction < entry.threshold).mean()
    assert score.num_points == 200


def test_parallel_planes():
    x, y = np.meshgrid(np.linspace(-1, 1, 21), np.linspace(-1, 1, 21))
    plane = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    gap = 0.05 * np.sqrt(2)  # in metres; the radius is sqrt(2)
    score = score_reconstruction(plane + [0, 0, gap], TruthCloud(plane))
    assert (score.precision, score.recall, score.f_score) == (1, 1, 1)
    assert astuple(score.chamfer_distances) == pytest.approx((0.05, 0.1, 2 * 0.05**2), rel=1e-12)
    assert [entry.f_score for entry in score.by_threshold if entry.threshold != 0.05] == [0, 0, 1, 1]


def test_shifted_sphere():
    # With r = |u + s|, u uniform on the sphere: the density of r is r / (2 s), so mean |r - 1| = s / 2
    # and the share of |r - 1| < d is d / s.
    points, shift = sphere(16_000), 0.5
    score = score_reconstruction(points + [0, 0, shift], TruthCloud(points), threshold=0.2)
    # Neighbours on the sphere are 0.03 apart, which lengthens the shortest distances only.
    assert score.chamfer == pytest.approx(shift / 2, abs=0.001)
    assert score.precision == pytest.approx(0.2 / shift, abs=0.002)
    assert score.recall == pytest.approx(0.2 / shift, abs=0.002)


def test_the_threshold_itself_is_too_far():
    truth = TruthCloud(np.array([(1.0, 0, 0), (-1.0, 0, 0)]))
    point = [(1.25, 0, 0)]
    assert score_reconstruction(point, truth, threshold=0.25).precision == 0
    assert score_reconstruction(point, truth, threshold=0.2500001).precision == 1


@pytest.mark.parametrize("scale", [1.0, 0.003, 40.0])
def test_motion_and_scale_change_nothing(rng, scale):
    truth, prediction = rng.normal(size=(500, 3)), rng.normal(size=(400, 3))
    turn, shift = Rotation.random(rng=rng), rng.normal(size=3) * 10
    expected = score_reconstruction(prediction, TruthCloud(truth))
    moved = score_reconstruction(
        scale * turn.apply(prediction) + shift, TruthCloud(scale * turn.apply(truth) + shift)
    )
    assert (moved.precision, moved.recall) == (expected.precision, expected.recall)
    # Rounding: coordinates of 10 m with differences of 3 mm.
    assert moved.chamfer == pytest.approx(expected.chamfer, rel=1e-10)


def test_exchange_of_the_clouds_exchanges_precision_and_recall(rng):
    first = sphere(500)
    second = sphere(700)[rng.permutation(700)]  # same centroid and radius, to rounding
    one, other = (
        score_reconstruction(second, TruthCloud(first)),
        score_reconstruction(first, TruthCloud(second)),
    )
    assert (one.precision, one.recall) == (other.recall, other.precision)
    assert one.chamfer == pytest.approx(other.chamfer, rel=0.01)  # centroids differ by 1 / 500


def test_the_truth_scores_full_marks(rng):
    points = rng.normal(size=(1000, 3))
    score = score_reconstruction(points, TruthCloud(points))
    assert (score.precision, score.recall, score.f_score, score.chamfer) == (1, 1, 1, 0)


def test_nothing_scores_nothing():
    score = score_reconstruction(np.empty((0, 3)), TruthCloud(sphere(100)))
    assert (score.precision, score.recall, score.f_score, score.chamfer, score.num_points) == (0, 0, 0, 1, 0)
    assert astuple(score.chamfer_distances) == (1, 1, 1)
    assert all(entry.f_score == 0 for entry in score.by_threshold)


def test_many_points_are_thinned_evenly_few_are_left():
    truth = TruthCloud(sphere(4000))
    # 17,000 points crowd one spot, 1,000 cover the rest: what is left covers as before.
    crowd = np.concatenate([[0, 0, 1] + 1e-4 * sphere(17_000), sphere(1000)])
    score = score_reconstruction(crowd, truth)
    assert score.num_points == MAX_POINTS
    assert score.recall == score_reconstruction(sphere(1000), truth).recall == 1
    assert score_reconstruction(crowd[:10], truth).num_points == 10


def test_f_is_the_harmonic_mean():
    assert ThresholdScore(0.08, 0.5, 0.25).f_score == pytest.approx(1 / 3)
    assert ThresholdScore(0.08, 0.0, 0.0).f_score == 0.0


def test_coverage_counts_truth_near_the_points():
    truth = TruthCloud(sphere(10_000))
    cap = truth.points_m[truth.points_m[:, 2] > 0.5]  # a quarter of the sphere
    # The margin of 0.08 adds a ring; the last points stand up to one spacing, 0.035, behind the cap's rim.
    expected = (1 - np.cos(np.pi / 3 + 0.08)) / 2
    assert expected - 0.035 * np.sin(np.pi / 3) / 2 < coverage(cap, truth) < expected
    assert coverage(cap, truth, distance=1e-6) == pytest.approx(0.25, abs=1e-3)
    assert coverage([], truth) == 0.0


def test_variants_by_name(rng):
    truth, prediction = TruthCloud(rng.normal(size=(50, 3))), rng.normal(size=(60, 3))
    for variant in ("half_sum", "sum", "squared_sum"):
        score = score_reconstruction(prediction, truth, chamfer_variant=variant)
        assert score.chamfer == getattr(score.chamfer_distances, variant)


def test_bad_input_is_refused():
    truth = TruthCloud(sphere(100))
    with pytest.raises(MeshError, match="prediction: 1 of 1 points are not finite"):
        score_reconstruction([(0, np.nan, 0)], truth)
    with pytest.raises(RadarError, match="threshold"):
        score_reconstruction([(0, 0, 0)], truth, threshold=0)
    with pytest.raises(RadarError, match="half_sum, sum or squared_sum"):
        score_reconstruction([(0, 0, 0)], truth, chamfer_variant="cd")
