"""The population search."""

from __future__ import annotations

import numpy as np

from waveformer.simulator.pose_search import search
from waveformer.simulator.rigid_pose import RigidPose

START = RigidPose(np.eye(3), np.array([0.0, 0.0, -0.4]))
DEVIATIONS = np.array(3 * [0.003] + 3 * [np.radians(3.0)])
AIM = START.moved(DEVIATIONS * [1.0, -0.8, 0.5, 0.9, -1.2, 0.7])


def misfits(poses: list[RigidPose]) -> np.ndarray:
    """A bowl with a ripple that would catch a descent."""
    values = []
    for pose in poses:
        shift_m, turn_deg = pose.apart(AIM)
        values.append((shift_m / 0.003) ** 2 + (turn_deg / 3.0) ** 2 - 0.3 * np.cos(20 * shift_m / 0.003))
    return np.array(values)


def test_the_population_gathers_at_the_minimum() -> None:
    mean, best = search(misfits, START, DEVIATIONS, np.random.default_rng(0))
    first = misfits([START])[0]
    assert misfits([best])[0] < 0.1 * first
    assert misfits([mean])[0] < 0.2 * first


def test_a_seed_fixes_the_search() -> None:
    pairs = [search(misfits, START, DEVIATIONS, np.random.default_rng(seed)) for seed in (5, 5, 6)]
    assert pairs[0][1].apart(pairs[1][1]) == (0.0, 0.0)
    assert pairs[0][1].apart(pairs[2][1])[0] > 0.0
