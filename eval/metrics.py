"""How close a cloud comes to the ground truth: precision, recall, F-score and Chamfer distance.

All lengths are radii of the sphere around the ground truth (centre = centroid, radius 1). The threshold 0.08 and
the halved, unsquared Chamfer distance are the defaults because they reproduce the first-principle rows of the
Wave-Former paper, whose text fixes neither; definitions of precision, recall and F: Tatarchenko et al. 2019.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from waveformer.datagen.farthest_points import farthest_points
from waveformer.datagen.truth_cloud import TruthCloud, finite_points
from waveformer.simulator.errors import RadarError

ChamferVariant = Literal["half_sum", "sum", "squared_sum"]

MAX_POINTS = 16_384
THRESHOLD = 0.08
REPORTED_THRESHOLDS = (0.01, 0.02, 0.05, 0.08, 0.1)
# What the contract sets for an empty prediction.
EMPTY_CHAMFER = 1.0


@dataclass(frozen=True)
class ThresholdScore:
    """Scores at one threshold.

    Attributes:
        threshold: in radii; a point counts if its nearest neighbour is nearer than this.
        precision: share of the prediction near the truth.
        recall: share of the truth near the prediction.
    """

    threshold: float
    precision: float
    recall: float

    @property
    def f_score(self) -> float:
        """Harmonic mean of precision and recall, 0 if both are."""
        total = self.precision + self.recall
        return 2 * self.precision * self.recall / total if total > 0 else 0.0


@dataclass(frozen=True)
class ChamferDistances:
    """The same nearest-neighbour distances d (in radii) in the three ways that are in use.

    Attributes:
        half_sum: (mean d, prediction to truth + mean d, truth to prediction) / 2.
        sum: the two means, not halved.
        squared_sum: the two means of d squared, not halved.
    """

    half_sum: float
    sum: float
    squared_sum: float


@dataclass(frozen=True)
class ReconstructionScore:
    """Scores of one cloud.

    Attributes:
        precision, recall, f_score: 0 .. 1 at `threshold`.
        chamfer: in radii (squared radii for "squared_sum").
        threshold, chamfer_variant: what the figures above were computed with.
        by_threshold: scores at every one of `REPORTED_THRESHOLDS`.
        chamfer_distances: all variants.
        num_points: points of the prediction that were scored, after thinning.
    """

    precision: float
    recall: float
    f_score: float
    chamfer: float
    threshold: float
    chamfer_variant: ChamferVariant
    by_threshold: tuple[ThresholdScore, ...]
    chamfer_distances: ChamferDistances
    num_points: int


def score_reconstruction(
    prediction_m: ArrayLike,
    truth: TruthCloud,
    *,
    threshold: float = THRESHOLD,
    chamfer_variant: ChamferVariant = "half_sum",
) -> ReconstructionScore:
    """Compare a predicted cloud with the ground truth.

    Args:
        prediction_m: (P, 3) metres in the frame of the truth; thinned to `MAX_POINTS` by farthest-point
            sampling if there are more, never padded. P = 0 scores precision = recall = F = 0 and every Chamfer
            distance 1.
        truth: ground truth.
        threshold: of precision, recall and F, in radii.
        chamfer_variant: an attribute of `ChamferDistances`.

    Raises:
        MeshError: the prediction has another shape or is not finite.
        RadarError: threshold or variant make no sense.
    """
    if not (np.isfinite(threshold) and threshold > 0):
        raise RadarError(f"threshold must be a positive number of radii, got {threshold!r}")
    if chamfer_variant not in ("half_sum", "sum", "squared_sum"):
        raise RadarError(f"chamfer_variant must be half_sum, sum or squared_sum, got {chamfer_variant!r}")
    points_m = finite_points("prediction", prediction_m)
    points_m = points_m[farthest_points(points_m, MAX_POINTS)]
    to_truth, to_prediction = _nearest_distances(truth.to_unit_sphere(points_m), truth)
    chosen, *by_threshold = (
        ThresholdScore(limit, _share_below(to_truth, limit), _share_below(to_prediction, limit))
        for limit in (threshold, *REPORTED_THRESHOLDS)
    )
    distances = _chamfer_distances(to_truth, to_prediction)
    return ReconstructionScore(
        chosen.precision,
        chosen.recall,
        chosen.f_score,
        getattr(distances, chamfer_variant),
        threshold,
        chamfer_variant,
        tuple(by_threshold),
        distances,
        len(points_m),
    )


def coverage(points_m: ArrayLike, truth: TruthCloud, distance: float = THRESHOLD) -> float:
    """Share of the ground-truth points that have one of the points nearer than a distance in radii.

    The paper's coverage of a partial cloud, by which it sorts objects. Nothing is thinned.

    Raises:
        MeshError: the points have another shape or are not finite.
    """
    points_m = finite_points("partial", points_m)
    return _share_below(_nearest_distances(truth.to_unit_sphere(points_m), truth)[1], distance)


def _nearest_distances(
    points: NDArray[np.float64], truth: TruthCloud
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From every point to the truth (P,), and from every point of the truth to the points (G,)."""
    if len(points) == 0:
        return np.empty(0), np.full(len(truth.points_m), np.inf)
    to_truth, _ = truth.tree.query(points)
    to_points, _ = KDTree(points).query(truth.tree.data)
    return to_truth, to_points


def _share_below(distances: NDArray[np.float64], limit: float) -> float:
    return float((distances < limit).mean()) if len(distances) else 0.0


def _chamfer_distances(to_truth: NDArray[np.float64], to_prediction: NDArray[np.float64]) -> ChamferDistances:
    if len(to_truth) == 0:
        return ChamferDistances(EMPTY_CHAMFER, EMPTY_CHAMFER, EMPTY_CHAMFER)
    total = float(to_truth.mean() + to_prediction.mean())
    return ChamferDistances(total / 2, total, float((to_truth**2).mean() + (to_prediction**2).mean()))
