"""Bootstrap intervals against their large-number limit."""

import numpy as np
import pytest

from waveformer.eval.bootstrap import bootstrap_mean
from waveformer.simulator.errors import RadarError


def test_width_of_one_class(rng):
    values = rng.normal(size=400)
    estimate = bootstrap_mean(values, ["small"] * 400, rng, num_resamples=20_000)
    assert estimate.mean == pytest.approx(values.mean())
    # Central limit theorem: 1.96 standard errors. The 2.5 % quantile of 20,000 draws scatters by 2 %.
    half_width = 1.96 * values.std() / 20
    assert estimate.high - estimate.mean == pytest.approx(half_width, rel=0.06)
    assert estimate.mean - estimate.low == pytest.approx(half_width, rel=0.06)


def test_width_of_a_mean_of_class_means(rng):
    values, labels = rng.normal(size=500) * np.repeat([1, 3], [400, 100]), ["large"] * 400 + ["small"] * 100
    estimate = bootstrap_mean(values, labels, rng, num_resamples=20_000)
    variance = (values[:400].var() / 400 + values[400:].var() / 100) / 4
    assert estimate.high - estimate.low == pytest.approx(2 * 1.96 * np.sqrt(variance), rel=0.05)


def test_kinds_of_mean(rng):
    values, labels = [1.0, 1.0, 1.0, 5.0], ["small"] * 3 + ["large"]
    assert bootstrap_mean(values, labels, rng).mean == 3.0
    assert bootstrap_mean(values, labels, rng, mean_kind="objects").mean == 2.0


def test_classes_keep_their_numbers(rng):
    # Nothing differs within a class, so nothing can come out otherwise.
    estimate = bootstrap_mean(
        [1.0, 1.0, 5.0, 5.0, 5.0], ["small"] * 2 + ["large"] * 3, rng, mean_kind="objects"
    )
    assert (estimate.low, estimate.mean, estimate.high) == pytest.approx((3.4, 3.4, 3.4))


def test_the_seed_decides(rng):
    values, labels = rng.normal(size=10), ["small"] * 10
    first, again, other = (bootstrap_mean(values, labels, np.random.default_rng(seed)) for seed in (0, 0, 1))
    assert first == again
    assert first != other


@pytest.mark.parametrize(("values", "labels"), [([], []), ([1.0], []), ([1.0, np.nan], ["a", "a"])])
def test_bad_input_is_refused(rng, values, labels):
    with pytest.raises(RadarError, match="bootstrap"):
        bootstrap_mean(values, labels, rng)
