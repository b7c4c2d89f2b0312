"""Clouds with a fixed number of rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError


class FixedCloud(NamedTuple):
    """A cloud as an array of a fixed size.

    Attributes:
        points_m: (K, 3) float32; rows from `num_valid` on are NaN.
        num_valid: how many rows hold a point.
    """

    points_m: NDArray[np.float32]
    num_valid: int


def fixed_size(points_m: NDArray[np.float64], num_points: int) -> FixedCloud:
    """A cloud with NaN rows up to a number of points: a repeated point would look like a denser surface.

    Raises:
        RadarError: the cloud has more points.
    """
    if len(points_m) > num_points:
        raise RadarError(f"a cloud of {len(points_m)} points does not fit into {num_points}: thin it first")
    fixed = np.full((num_points, 3), np.nan, dtype=np.float32)
    fixed[: len(points_m)] = points_m
    return FixedCloud(fixed, len(points_m))


def without_padding(points_m: NDArray[np.float32], num_valid: int) -> NDArray[np.float64]:
    """The points of a fixed cloud, (num_valid, 3)."""
    return points_m[:num_valid].astype(np.float64)
