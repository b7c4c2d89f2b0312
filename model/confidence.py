"""A confidence of our own, 0 .. 1: a logistic score of a few interpretable features.

The paper's ratio finds clouds flooded by white noise; wrong levels and phase errors pass it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.model.confidence_features import ConfidenceFeatures
from waveformer.simulator.errors import RadarError

_MAX_STEPS = 100
_STEP_TOLERANCE = 1e-10


@dataclass(frozen=True)
class Confidence:
    """score = 1 / (1 + exp(-(intercept + sum_i weights_i (x_i - means_i) / scales_i))).

    Attributes:
        intercept: log odds of an average reconstruction.
        weights: per standardised feature, in the order of `ConfidenceFeatures`.
        means, scales: of the features the weights were fitted to.
    """

    intercept: float
    weights: tuple[float, ...]
    means: tuple[float, ...]
    scales: tuple[float, ...]

    def __post_init__(self) -> None:
        numbers = (self.intercept, *self.weights, *self.means, *self.scales)
        if not len(self.weights) == len(self.means) == len(self.scales) or len(self.weights) == 0:
            raise RadarError("a confidence needs as many means and scales as weights, at least one")
        if not np.isfinite(numbers).all() or min(self.scales) <= 0:
            raise RadarError("a confidence needs finite coefficients and positive scales")

    def score(self, features: ConfidenceFeatures | Sequence[float] | None) -> float:
        """Confidence in one reconstruction; 0 for None or for features that are not finite.

        Raises:
            RadarError: another number of features than weights.
        """
        if features is None:
            return 0.0
        values = np.asarray(features, dtype=np.float64)
        if values.shape != (len(self.weights),):
            raise RadarError(
                f"this confidence weighs {len(self.weights)} features, got {values.size}: fit it again"
            )
        if not np.isfinite(values).all():
            return 0.0
        standard = (values - np.array(self.means)) / np.array(self.scales)
        return float(_logistic(np.array(self.intercept + standard @ np.array(self.weights))))


def fit_confidence(features: ArrayLike, good: ArrayLike, penalty: float = 1.0) -> Confidence:
    """Logistic regression with an L2 penalty, by Newton's method.

    It minimises sum log(1 + exp(-y_i z_i)) + penalty / 2 * |weights|^2 over standardised features, y = +-1; the
    intercept is free. The penalty also keeps the weights finite where one feature separates the classes.

    Args:
        features: shape (n, F).
        good: whether a reconstruction is good, shape (n,).
        penalty: positive.

    Raises:
        RadarError: shapes do not fit, numbers are not finite, one class is missing, or the penalty is not positive.
    """
    x, y = np.asarray(features, dtype=np.float64), np.asarray(good)
    if x.ndim != 2 or x.shape[1] == 0 or y.shape != (len(x),):
        raise RadarError(f"fit needs features (n, F) and good (n,), got {x.shape} and {y.shape}")
    if not np.isfinite(x).all() or not np.isin(y, (0, 1)).all():
        raise RadarError("fit needs finite features, and good as true or false")
    if y.all() or not y.any():
        raise RadarError("fit needs good and bad reconstructions, all are of one kind")
    if not (np.isfinite(penalty) and penalty > 0):
        raise RadarError(f"fit needs a positive penalty, got {penalty!r}")
    means, scales = x.mean(axis=0), x.std(axis=0)
    scales = np.where(scales > 1e-12 * (1.0 + np.abs(means)), scales, 1.0)
    design = np.concatenate([np.ones((len(x), 1)), (x - means) / scales], axis=1)
    ridge = np.full(design.shape[1], float(penalty))
    ridge[0] = 0.0
    beta = _newton(design, y.astype(np.float64), ridge)
    return Confidence(float(beta[0]), _floats(beta[1:]), _floats(means), _floats(scales))


def _newton(
    design: NDArray[np.float64], target: NDArray[np.float64], ridge: NDArray[np.float64]
) -> NDArray[np.float64]:
    beta = np.zeros(design.shape[1])
    cost = _cost(design, target, ridge, beta)
    for _ in range(_MAX_STEPS):
        probability = _logistic(design @ beta)
        gradient = design.T @ (probability - target) + ridge * beta
        curvature = (design * (probability * (1.0 - probability))[:, None]).T @ design + np.diag(ridge)
        step = np.linalg.lstsq(curvature, gradient, rcond=None)[0]
        length = 1.0
        while _cost(design, target, ridge, beta - length * step) > cost and length > 1e-6:
            length *= 0.5  # far from the optimum a full step may overshoot
        beta = beta - length * step
        cost = _cost(design, target, ridge, beta)
        if np.abs(length * step).max() < _STEP_TOLERANCE:
            break
    return beta


def _cost(
    design: NDArray[np.float64],
    target: NDArray[np.float64],
    ridge: NDArray[np.float64],
    beta: NDArray[np.float64],
) -> float:
    log_odds = design @ beta
    return float((np.logaddexp(0.0, log_odds) - target * log_odds).sum() + 0.5 * (ridge * beta**2).sum())


def _logistic(log_odds: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * log_odds)))


def _floats(values: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
