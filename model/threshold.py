"""Which voxels belong to the specular reflections: Li's threshold over the whole imaged volume.

The volume is a crop around the object, imaged in full, and a background of samples, each of which stands for
many voxels. Li & Tam, "An iterative algorithm for minimum cross entropy thresholding", 1998.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.model.bounding_box import box_exceeds
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

# mmNorm's rules: the exponents of |S| in the order they are tried, the box that the reflections of one object
# fit in, and the share of max |S| below which no normal is estimated.
EXPONENTS = (2.0, 2.5, 3.5, 4.0)
LARGEST_BOX_M3 = 0.03
NORMAL_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class Background:
    """Samples of the volume outside the crop.

    Attributes:
        magnitude: |S|, shape (B,).
        weight: how many voxels of the crop's spacing each stands for, shape (B,).
    """

    magnitude: NDArray[np.float64]
    weight: NDArray[np.float64]

    def __post_init__(self) -> None:
        magnitude = np.array(self.magnitude, dtype=np.float64)
        weight = np.array(self.weight, dtype=np.float64)
        if magnitude.ndim != 1 or weight.shape != magnitude.shape:
            raise RadarError(
                f"background magnitude and weight must both have shape (B,), got {magnitude.shape} "
                f"and {weight.shape}"
            )
        for name, values in (("magnitude", magnitude), ("weight", weight)):
            if not np.isfinite(values).all() or (values < 0).any():
                raise RadarError(f"background {name} must be finite and not negative")
            values.setflags(write=False)
            object.__setattr__(self, name, values)


@dataclass(frozen=True, eq=False)
class SpecularMask:
    """The voxels that reflect specularly.

    Attributes:
        mask: shape (X, Y, Z).
        exponent: power of |S| that Li's threshold was taken of; 0 for an image without echo.
        threshold_of_magnitude: least |S| of the mask.
        reason: why the mask is empty or should not be trusted; "" otherwise.
    """

    mask: NDArray[np.bool_]
    exponent: float
    threshold_of_magnitude: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class _Samples:
    """Ascending values and how often each counts, both of shape (n,); None = each counts once."""

    values: NDArray[np.float64]
    weights: NDArray[np.float64] | None

    def counts(self) -> NDArray[np.float64]:
        """How many voxels the samples before each place stand for, shape (n + 1,)."""
        if self.weights is None:
            return np.arange(len(self.values) + 1, dtype=np.float64)
        return np.concatenate([[0.0], np.cumsum(self.weights)])

    def totals(self, least: float) -> NDArray[np.float64]:
        """Sum of the values before each place, counted from the least one, shape (n + 1,)."""
        sums = np.empty(len(self.values) + 1)
        sums[0] = 0.0
        above = self.values - least
        np.cumsum(above if self.weights is None else above * self.weights, out=sums[1:])
        return sums


def li_threshold(values: ArrayLike, weights: ArrayLike | None = None) -> float:
    """Li's minimum cross entropy threshold of samples.

    Agrees with scikit-image's `threshold_li` (start at the mean, values counted from the least one), to the
    difference of neighbouring values.

    Args:
        values: finite, any shape.
        weights: how often each value counts, same shape, not negative; None = once.

    Returns:
        The threshold; the value itself where all are equal.

    Raises:
        RadarError: no value, or one that is not finite.
    """
    flat = np.asarray(values, dtype=np.float64).reshape(-1)
    counts = np.ones(len(flat)) if weights is None else np.asarray(weights, dtype=np.float64).reshape(-1)
    if len(counts) != len(flat) or not (counts >= 0).all():
        raise RadarError("li_threshold needs one weight that is not negative for every value")
    flat, counts = flat[counts > 0], counts[counts > 0]
    if len(flat) == 0 or not np.isfinite(flat).all():
        raise RadarError("li_threshold needs at least one value, and finite ones only")
    order = np.argsort(flat)
    return _least_cross_entropy([_Samples(flat[order], counts[order])])


def specular_mask(
    image: NDArray[np.complex64], grid: Grid, background: Background | None = None
) -> SpecularMask:
    """Voxels above Li's threshold of |S|^e over the whole volume and above 5 % of max |S|.

    e is the first of 2, 2.5, 3.5, 4 whose voxels of the crop fit an oriented box of 0.03 m^3, else 4 (mmNorm).
    What reflects far from the crop is cut off with it and raises the threshold no further.

    Args:
        image: focused S, shape (X, Y, Z).
        grid: its voxels.
        background: the rest of the volume; None = the crop is all.

    Raises:
        RadarError: the image does not fit the grid or holds non-finite voxels.
    """
    if np.shape(image) != grid.shape:
        raise RadarError(f"image of shape {np.shape(image)} does not fit the grid {grid.shape}")
    magnitude = np.abs(image)
    if not np.isfinite(magnitude).all():
        raise RadarError(f"the image holds {int((~np.isfinite(magnitude)).sum())} non-finite voxels")
    rest = background if background is not None else Background(np.empty(0), np.empty(0))
    peak = float(max(magnitude.max(), rest.magnitude.max(initial=0.0)))
    if peak == 0.0:
        return SpecularMask(np.zeros(grid.shape, dtype=bool), 0.0, 0.0, "the image is zero everywhere")
    # Relative to the peak, so that no power underflows.
    samples = [_Samples(np.sort(magnitude, axis=None).astype(np.float64) / peak, None)]
    if (counted := np.flatnonzero(rest.weight > 0)).size:
        order = counted[np.argsort(rest.magnitude[counted])]
        samples.append(_Samples(rest.magnitude[order] / peak, rest.weight[order]))
    exponent, threshold, reason = EXPONENTS[-1], 0.0, ""
    for exponent in EXPONENTS:
        powers = [_Samples(part.values**exponent, part.weights) for part in samples]
        threshold = float(peak * _least_cross_entropy(powers) ** (1 / exponent))
        if not box_exceeds(_kept_points(magnitude >= threshold, grid), LARGEST_BOX_M3):
            break
    else:
        reason = (
            f"what exceeds the threshold fills a box of more than {LARGEST_BOX_M3:g} m^3: "
            "noise or clutter reaches it"
        )
    threshold = max(threshold, NORMAL_SHARE * peak)
    mask = np.asarray(magnitude >= threshold)
    if not mask.any():
        reason = "nothing inside the grid reaches the threshold: what lies outside it is far stronger"
    return SpecularMask(mask, exponent, threshold, reason)


def _least_cross_entropy(samples: list[_Samples]) -> float:
    """Li's threshold of several sets of sorted samples taken together."""
    least = min(part.values[0] for part in samples)
    if max(part.values[-1] for part in samples) == least:
        return float(least)
    counts = [part.counts() for part in samples]
    totals = [part.totals(least) for part in samples]
    count = sum(part[-1] for part in counts)
    total = sum(part[-1] for part in totals)
    threshold, splits = total / count, [-1]
    # Both class means grow with the threshold and the next threshold grows with both: the sequence is
    # monotone, and stands still after finitely many splits.
    while True:
        found = [int(np.searchsorted(part.values, threshold + least, side="right")) for part in samples]
        count_below = sum(part[split] for part, split in zip(counts, found, strict=True))
        total_below = sum(part[split] for part, split in zip(totals, found, strict=True))
        if found == splits or total_below == 0.0 or count_below == count:
            return float(threshold + least)
        splits = found
        below, above = total_below / count_below, (total - total_below) / (count - count_below)
        threshold = (above - below) / np.log(above / below)


def _kept_points(mask: NDArray[np.bool_], grid: Grid) -> NDArray[np.float64]:
    """Positions that span the hull of all kept voxels: the two ends of every column."""
    columns = np.nonzero(mask.any(axis=2))
    kept = mask[columns]
    lowest, highest = kept.argmax(axis=1), kept.shape[1] - 1 - kept[:, ::-1].argmax(axis=1)
    ends = [
        np.stack([grid.x[columns[0]], grid.y[columns[1]], grid.z[end]], axis=1) for end in (lowest, highest)
    ]
    return np.concatenate(ends)
