"""Farthest-point sampling against its definition."""

from itertools import pairwise

import numpy as np
import pytest

from waveformer.datagen.farthest_points import farthest_order, farthest_points


def require_farthest(points, chosen):
    """Every choice is as far from those before it as any point is: the definition, by brute force."""
    spread = np.linalg.norm(points - points.mean(axis=0), axis=1)
    assert spread[chosen[0]] == spread.max()
    distance = np.full(len(points), np.inf)
    for before, index in pairwise(chosen):
        distance = np.minimum(distance, np.linalg.norm(points - points[before], axis=1))
        # Rounding of squared distances.
        assert distance[index] >= distance.max() * (1 - 1e-12)


def test_each_next_point_is_the_farthest(rng):
    points = rng.normal(size=(3000, 3)) * [1.0, 0.3, 0.01]
    chosen = farthest_points(points, 400)
    assert len(set(chosen.tolist())) == 400
    require_farthest(points, chosen)


def test_on_a_lattice_full_of_ties():
    points = np.stack(np.meshgrid(*[np.arange(9.0)] * 3), axis=-1).reshape(-1, 3)
    chosen = farthest_points(points, 300)
    assert len(set(chosen.tolist())) == 300
    require_farthest(points, chosen)


def one_by_one(points, count):
    """The slow twin: every point is asked after every choice."""
    chosen = [int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1)))]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return chosen


def crowds(rng):
    """Two crowds, far apart and denser than all else: too many pairs to list at once."""
    tight = 1e-4 * rng.normal(size=(8000, 3))
    return np.concatenate([tight[:4000], tight[4000:] + [5, 0, 0], rng.normal(size=(300, 3))])


@pytest.mark.parametrize("shape", ["volume", "sheet", "line", "crowds"])
def test_the_choice_of_the_slow_twin(rng, shape):
    flat = {"volume": [1.0, 1.0, 1.0], "sheet": [1.0, 0.5, 0.0], "line": [1.0, 0.0, 0.0]}
    points = crowds(rng) if shape == "crowds" else rng.normal(size=(5000, 3)) * flat[shape]
    assert farthest_points(points, 1500).tolist() == one_by_one(points, 1500)


def test_an_order_holds_all_subsets(rng):
    points = rng.normal(size=(1200, 3))
    order = farthest_order(points)
    assert sorted(order.tolist()) == list(range(1200))
    for count in (1, 2, 500, 1199):
        assert np.array_equal(order[:count], farthest_points(points, count))
    assert farthest_order(points[:1]).tolist() == [0]
    assert farthest_order(points[:0]).shape == (0,)


def test_an_order_puts_copies_last(rng):
    points = np.repeat(rng.normal(size=(400, 3)), 2, axis=0)
    order = farthest_order(points)
    assert sorted(order.tolist()) == list(range(800))
    assert len(np.unique(points[order[:400]], axis=0)) == 400


def test_all_points_where_there_are_no_more(rng):
    points = rng.normal(size=(50, 3))
    assert np.array_equal(farthest_points(points, 50), np.arange(50))
    assert np.array_equal(farthest_points(points, 60), np.arange(50))
    assert farthest_points(np.empty((0, 3)), 5).shape == (0,)


def test_repeated_points_come_last(rng):
    points = np.repeat(rng.normal(size=(100, 3)), 3, axis=0)
    distinct = np.unique(points[farthest_points(points, 100)], axis=0)
    assert len(distinct) == 100


@pytest.mark.parametrize("shift_m", [0.0, 5.0])
def test_place_and_order_do_not_matter(rng, shift_m):
    points = rng.normal(size=(1000, 3))
    order = rng.permutation(1000)
    chosen = points[farthest_points(points, 50)]
    again = (points + shift_m)[order][farthest_points((points + shift_m)[order], 50)] - shift_m
    np.testing.assert_allclose(again, chosen, atol=1e-12)  # rounding of the shift


def test_the_same_every_time(rng):
    points = rng.normal(size=(500, 3))
    assert np.array_equal(farthest_points(points, 100), farthest_points(points, 100))
