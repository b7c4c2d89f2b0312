"""The paper's classes of objects, and means over them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from waveformer.simulator.errors import RadarError
from waveformer.simulator.mesh import SurfaceMesh

SIZE_CLASSES = ("large", "medium", "small")
COVERAGE_CLASSES = ("high", "middle", "low")
# Bounds between neighbouring classes; what lies on a bound belongs to the middle class.
SIZE_BOUNDS_M = (0.20, 0.10)
COVERAGE_BOUNDS = (0.36, 0.18)


def longest_side_m(mesh: SurfaceMesh) -> float:
    """Longest side of the box along the axes of the mesh's own frame: measure before it is turned to its pose."""
    return float(mesh.extent_m.max())


def size_class(side_m: float) -> str:
    """Large (longest side over 20 cm), medium (10 to 20 cm) or small (under 10 cm).

    Raises:
        RadarError: the side is not positive.
    """
    if not (np.isfinite(side_m) and side_m > 0):
        raise RadarError(f"longest side must be positive metres, got {side_m!r}")
    return _classify(side_m, SIZE_BOUNDS_M, SIZE_CLASSES)


def coverage_class(share: float) -> str:
    """High (a partial cloud covers over 36 % of the truth), middle (18 to 36 %) or low (under 18 %).

    Raises:
        RadarError: the share is not within 0 .. 1.
    """
    if not 0 <= share <= 1:
        raise RadarError(f"coverage must be a share of 0 .. 1, got {share!r}")
    return _classify(share, COVERAGE_BOUNDS, COVERAGE_CLASSES)


def class_means(values: ArrayLike, labels: Sequence[str]) -> dict[str, float]:
    """Mean of the values (N,) of every class that occurs, classes in the order in which they first occur.

    Raises:
        RadarError: the sizes disagree.
    """
    numbers = np.asarray(values, dtype=np.float64)
    if len(numbers) != len(labels):
        raise RadarError(f"{len(numbers)} values for {len(labels)} class labels")
    names = np.asarray(labels)
    return {name: float(numbers[names == name].mean()) for name in dict.fromkeys(labels)}


def mean_of_class_means(values: ArrayLike, labels: Sequence[str]) -> float:
    """Every class that occurs counts the same, however many objects it has; NaN without objects."""
    means = class_means(values, labels)
    return float(np.mean(list(means.values()))) if means else float("nan")


def _classify(value: float, bounds: tuple[float, float], names: tuple[str, str, str]) -> str:
    upper, lower = bounds
    return names[0] if value > upper else names[2] if value < lower else names[1]
