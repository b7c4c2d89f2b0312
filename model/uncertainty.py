"""The paper's test of a chosen cloud: columns over voxels (Wave-Former, |C_xy| / |C| > 0.6 is uncertain)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from waveformer.simulator.errors import RadarError


class UncertaintyTest(BaseModel):
    """When a cloud is uncertain.

    Attributes:
        threshold: of the ratio. 0.6 belongs to voxels |f - level| < delta with delta = the voxel edge; it means
            nothing at other ratios of delta to voxel.
        direction: "above" flags ratios above the threshold, which finds the sheets that white noise breaks into
            single voxels; "below" flags stacked voxels.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    threshold: float = Field(default=0.6, ge=0.0, le=1.0)
    direction: Literal["above", "below"] = "above"

    def is_uncertain(self, ratio: float) -> bool:
        """Whether a cloud of this `column_ratio` is uncertain; NaN, an empty cloud, is."""
        if np.isnan(ratio):
            return True
        return bool(ratio > self.threshold if self.direction == "above" else ratio < self.threshold)


def column_ratio(points_m: NDArray[np.float64], spacing_m: float) -> float:
    """|C_xy| / |C|: distinct (x, y) columns over voxels.

    Args:
        points_m: centres of the voxels with |f - level| < the voxel edge, shape (P, 3).
        spacing_m: voxel edge.

    Returns:
        0 .. 1; NaN for no points.

    Raises:
        RadarError: points of another shape or not finite, or a spacing that is not positive.
    """
    points = np.asarray(points_m, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise RadarError(f"column_ratio needs finite points of shape (P, 3), got shape {points.shape}")
    if not (np.isfinite(spacing_m) and spacing_m > 0):
        raise RadarError(f"column_ratio needs a positive spacing in metres, got {spacing_m!r}")
    if len(points) == 0:
        return float("nan")
    columns = np.round((points[:, :2] - points[:, :2].min(axis=0)) / spacing_m).astype(np.int64)
    return len(np.unique(columns, axis=0)) / len(points)
