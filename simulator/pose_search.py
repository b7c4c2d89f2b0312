"""Search for a pose by a population that follows its best members."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.rigid_pose import RigidPose

_POPULATION, _ELITE, _GENERATIONS = 48, 8, 6
# How much of the spread a generation keeps from the one before.
_MEMORY = 0.3


def search(
    misfits: Callable[[list[RigidPose]], NDArray[np.float64]],
    start: RigidPose,
    deviations: NDArray[np.float64],
    rng: np.random.Generator,
) -> tuple[RigidPose, RigidPose]:
    """The cross-entropy method with the weights and the covariance update of CMA-ES.

    Sources: Rubinstein & Kroese, The Cross-Entropy Method, 2004; Hansen, The CMA Evolution Strategy: A Tutorial,
    2016, Eqs. 6 and 30 (rank-mu update about the old mean).

    Args:
        misfits: of a whole generation.
        start: middle of the first generation.
        deviations: its standard deviations along the arguments of `RigidPose.moved`, shape (6,).
        rng: for the members.

    Returns:
        Middle of the last generation, and the best member of all.
    """
    mean, covariance = np.zeros(6), np.eye(6)
    best: tuple[float, NDArray[Any]] | None = None
    ranks = np.log(_ELITE + 0.5) - np.log(np.arange(1, _ELITE + 1))
    weights = ranks / ranks.sum()
    for _ in range(_GENERATIONS):
        root = np.linalg.cholesky(covariance + 1e-6 * np.eye(6))
        members = mean + rng.normal(size=(_POPULATION, 6)) @ root.T
        if best is not None:
            members[0] = best[1]
        values = misfits([start.moved(member * deviations) for member in members])
        elite = np.argsort(values, kind="stable")[:_ELITE]
        if best is None or values[elite[0]] < best[0]:
            best = (float(values[elite[0]]), members[elite[0]])
        steps = members[elite] - mean
        covariance = _MEMORY * covariance + (1.0 - _MEMORY) * (weights[:, None] * steps).T @ steps
        mean = mean + weights @ steps
    assert best is not None
    return start.moved(mean * deviations), start.moved(best[1] * deviations)
