"""The logistic score and its fit."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.model.confidence import Confidence, fit_confidence
from waveformer.simulator.errors import RadarError


def test_score_by_hand() -> None:
    confidence = Confidence(0.5, (1.0, -2.0), (3.0, 0.0), (2.0, 1.0))
    # 0.5 + (5 - 3) / 2 - 2 * 0.25 = 1
    assert confidence.score((5.0, 0.25)) == pytest.approx(1 / (1 + np.exp(-1.0)))


def test_what_cannot_be_computed_earns_no_trust() -> None:
    confidence = Confidence(9.0, (1.0,), (0.0,), (1.0,))
    assert confidence.score(None) == 0.0
    assert confidence.score((np.nan,)) == 0.0
    assert confidence.score((1e9,)) == 1.0


def test_the_fit_is_a_minimum_of_its_cost(rng: np.random.Generator) -> None:
    features = rng.normal(size=(60, 3)) * [1.0, 10.0, 0.1] + [0.0, 5.0, -2.0]
    good = features[:, 0] + 0.1 * features[:, 1] + rng.normal(size=60) > 0.5
    fitted = fit_confidence(features, good, penalty=0.3)
    standard = (features - fitted.means) / fitted.scales

    def cost(beta: np.ndarray) -> float:
        z = beta[0] + standard @ beta[1:]
        return np.logaddexp(0, np.where(good, -z, z)).sum() + 0.15 * (beta[1:] ** 2).sum()

    at = np.array([fitted.intercept, *fitted.weights])
    for direction in rng.normal(size=(20, 4)):
        assert cost(at + 1e-3 * direction) > cost(at)
    gradient = [(cost(at + 1e-5 * unit) - cost(at - 1e-5 * unit)) / 2e-5 for unit in np.eye(4)]
    assert gradient == pytest.approx(np.zeros(4), abs=1e-6)  # central differences of a cost of about 30


def test_the_fit_orders_what_it_was_shown(rng: np.random.Generator) -> None:
    good = rng.random(200) < 0.5
    features = rng.normal(size=(200, 2)) + np.stack([2.0 * good, np.zeros(200)], axis=1)
    fitted = fit_confidence(features, good)
    scores = np.array([fitted.score(row) for row in features])
    assert scores[good].mean() > 0.7
    assert scores[~good].mean() < 0.3
    assert abs(fitted.weights[1]) < 0.3 * fitted.weights[0]


def test_separable_and_constant_features_stay_finite() -> None:
    features = np.array([[0.0, 7.0], [1.0, 7.0], [2.0, 7.0], [3.0, 7.0]])
    fitted = fit_confidence(features, [False, False, True, True])
    assert fitted.weights[0] > 0
    assert fitted.weights[1] == 0.0
    assert np.isfinite([fitted.intercept, *fitted.weights]).all()


def test_bad_input_is_refused() -> None:
    with pytest.raises(RadarError, match="all are of one kind"):
        fit_confidence(np.zeros((3, 2)), np.ones(3))
    with pytest.raises(RadarError, match="finite"):
        fit_confidence(np.full((3, 2), np.nan), np.array([0, 1, 1]))
    with pytest.raises(RadarError, match=r"\(n, F\)"):
        fit_confidence(np.zeros(3), np.ones(3))
    with pytest.raises(RadarError, match="penalty"):
        fit_confidence(np.zeros((2, 1)), np.array([0, 1]), penalty=0.0)
    with pytest.raises(RadarError, match="as many means"):
        Confidence(0.0, (1.0,), (), (1.0,))
    with pytest.raises(RadarError, match="positive scales"):
        Confidence(0.0, (1.0,), (0.0,), (0.0,))
    with pytest.raises(RadarError, match="fit it again"):
        Confidence(0.0, (1.0,), (0.0,), (1.0,)).score((1.0, 2.0))
