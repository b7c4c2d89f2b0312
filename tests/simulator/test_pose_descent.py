"""Levenberg-Marquardt over poses, and signals whose groups have gains of their own."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.pose_descent import FreeGains, descend
from waveformer.simulator.rigid_pose import RigidPose

GROUPS = np.array([0, 2, 1, 1, 0, 2, 2, 1])
START = RigidPose(np.eye(3), np.array([0.0, 0.0, -0.4]))


def complex_normal(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def squared(free: FreeGains, signal: np.ndarray) -> float:
    residual, _ = free.linearise(signal, np.zeros((*signal.shape, 1)))
    return float(residual @ residual)


def test_gains_of_groups_are_free(rng: np.random.Generator) -> None:
    measured, gains = complex_normal(rng, 8, 4), complex_normal(rng, 3)
    assert squared(FreeGains(measured, GROUPS), gains[GROUPS, None] * measured) < 1e-25
    assert squared(FreeGains(measured, None), gains[GROUPS, None] * measured) > 0.1


def test_the_gains_are_the_best_ones(rng: np.random.Generator) -> None:
    measured, signal = complex_normal(rng, 8, 4), complex_normal(rng, 8, 4)
    left = 0.0
    for group in range(3):
        a, b = signal[group == GROUPS].reshape(-1, 1), measured[group == GROUPS].ravel()
        left += float(np.linalg.lstsq(a, b)[1][0])
    expected = left / np.linalg.norm(measured) ** 2
    assert squared(FreeGains(measured, GROUPS), signal) == pytest.approx(expected)


def test_a_motion_that_only_turns_the_gains_has_no_slope(rng: np.random.Generator) -> None:
    signal, turns = complex_normal(rng, 8, 4), complex_normal(rng, 3)
    free, column = FreeGains(complex_normal(rng, 8, 4), GROUPS), turns[GROUPS, None] * signal
    _, slopes = free.linearise(signal, column[..., None])
    assert np.abs(slopes).max() < 1e-14


@pytest.mark.parametrize("groups", [GROUPS, None])
def test_the_gradient_equals_central_differences(rng: np.random.Generator, groups: np.ndarray | None) -> None:
    free = FreeGains(complex_normal(rng, 8, 4), groups)
    signal, columns = complex_normal(rng, 8, 4), complex_normal(rng, 8, 4, 6)
    residual, slopes = free.linearise(signal, columns)
    told = 2 * slopes.T @ residual
    step = 1e-6
    for axis in range(6):
        ends = [squared(free, signal + sign * step * columns[..., axis]) for sign in (-1, 1)]
        assert told[axis] == pytest.approx((ends[1] - ends[0]) / (2 * step), rel=1e-6, abs=1e-8)


def test_descent_ends_where_the_residual_vanishes(rng: np.random.Generator) -> None:
    aim = START.moved([0.002, -0.001, 0.003, 0.02, 0.05, -0.03])
    points = rng.uniform(-0.05, 0.05, (20, 3))

    def linearised(pose: RigidPose) -> tuple[np.ndarray, np.ndarray]:
        turned = points @ pose.rotation.T
        residual = turned + pose.center_m - points @ aim.rotation.T - aim.center_m
        slopes = np.zeros((20, 3, 6))
        slopes[..., :3] = np.eye(3)
        for axis in range(3):
            slopes[..., 3 + axis] = np.cross(np.eye(3)[axis], turned)
        return residual.ravel(), slopes.reshape(-1, 6)

    found, misfit = descend(linearised, START, 20)
    shift_m, turn_deg = found.apart(aim)
    # a step may end the descent once it is below 0.2 mm and gains below 0.1 %: quadratic steps go far beyond
    assert shift_m < 1e-7
    assert turn_deg < 1e-4
    assert misfit < 1e-12


def test_a_pose_without_a_way_down_stays() -> None:
    def linearised(pose: RigidPose) -> tuple[np.ndarray, np.ndarray]:
        # the slopes are wrong: every step makes it worse
        return np.array([1.0 + np.linalg.norm(pose.center_m - START.center_m)]), np.ones((1, 6))

    found, misfit = descend(linearised, START, 5)
    assert found is START
    assert misfit == 1.0
