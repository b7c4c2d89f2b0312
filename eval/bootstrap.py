"""How far a mean over objects could have come out otherwise: the percentile bootstrap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.errors import RadarError

MeanKind = Literal["size_classes", "objects"]
NUM_RESAMPLES = 2000


@dataclass(frozen=True)
class Estimate:
    """A mean and its interval.

    Attributes:
        mean: of the objects at hand.
        low, high: percentiles of the resampled means.
    """

    mean: float
    low: float
    high: float


def bootstrap_mean(
    values: ArrayLike,
    labels: Sequence[str],
    rng: np.random.Generator,
    *,
    mean_kind: MeanKind = "size_classes",
    confidence: float = 0.95,
    num_resamples: int = NUM_RESAMPLES,
) -> Estimate:
    """Mean over objects with a percentile interval (Efron and Tibshirani 1993, section 13.3).

    Objects are drawn with replacement within their class, so every resample has the classes' numbers.

    Args:
        values: one per object, (N,), finite.
        labels: class of every object, (N,).
        rng: random numbers.
        mean_kind: "objects": every object counts the same; "size_classes": every class that occurs does.
        confidence: share of the resampled means inside the interval.
        num_resamples: number of resamples.

    Raises:
        RadarError: no values, values that are not finite, sizes that disagree, or parameters out of range.
    """
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.shape != (len(labels),) or len(labels) == 0:
        raise RadarError(f"bootstrap needs a value and a class per object, got {numbers.size}, {len(labels)}")
    if not np.isfinite(numbers).all():
        raise RadarError(
            f"bootstrap: {int((~np.isfinite(numbers)).sum())} of {len(labels)} values not finite"
        )
    if not (0 < confidence < 1 and num_resamples > 0):
        raise RadarError(f"bootstrap: confidence {confidence!r} or num_resamples {num_resamples!r} unusable")
    names = np.asarray(labels)
    classes = list(dict.fromkeys(labels))
    mean, resampled = 0.0, np.zeros(num_resamples)
    for name in classes:
        members: NDArray[np.float64] = numbers[names == name]
        weight = 1 / len(classes) if mean_kind == "size_classes" else len(members) / len(numbers)
        drawn = rng.integers(len(members), size=(num_resamples, len(members)))
        mean += weight * float(members.mean())
        resampled += weight * members[drawn].mean(axis=1)
    low, high = np.quantile(resampled, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Estimate(mean, float(low), float(high))
