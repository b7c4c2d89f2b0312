"""The ground-truth points of one object and the unit sphere they fit."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from waveformer.simulator.errors import MeshError


@dataclass(frozen=True, eq=False)
class TruthCloud:
    """Points of an object's surface; lengths "in radii" are measured in the sphere around them.

    Attributes:
        points_m: (G, 3) metres.
        normals: (G, 3) unit normals of the surface, either way round; None if unknown.
    """

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        points_m = finite_points("ground truth", self.points_m)
        if len(points_m) == 0 or not np.ptp(points_m, axis=0).any():
            raise MeshError(
                "truth.degenerate", f"ground truth: {len(points_m)} points in one place; sample a surface"
            )
        object.__setattr__(self, "points_m", points_m)
        if self.normals is not None:
            normals = finite_points("ground-truth normals", self.normals)
            if normals.shape != points_m.shape:
                raise MeshError(
                    "truth.normals", f"ground truth: {len(normals)} normals for {len(points_m)} points"
                )
            object.__setattr__(self, "normals", normals)

    @cached_property
    def center_m(self) -> NDArray[np.float64]:
        """Centroid of the points, shape (3,)."""
        return np.asarray(self.points_m.mean(axis=0))

    @cached_property
    def radius_m(self) -> float:
        """Largest distance of a point from the centroid."""
        return float(np.linalg.norm(self.points_m - self.center_m, axis=1).max())

    @cached_property
    def tree(self) -> KDTree:
        """Of the points in unit-sphere coordinates."""
        return KDTree(self.to_unit_sphere(self.points_m))

    def to_unit_sphere(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Any points (..., 3) of the same frame, with the centroid at 0 and the radius 1."""
        return (points_m - self.center_m) / self.radius_m


def finite_points(name: str, points_m: ArrayLike) -> NDArray[np.float64]:
    """A read-only float64 copy of a cloud, (P, 3), P = 0 allowed.

    Raises:
        MeshError: ``cloud.shape`` or ``cloud.nonfinite``.
    """
    try:
        points = np.array(points_m, dtype=np.float64)
    except (TypeError, ValueError):
        raise MeshError("cloud.shape", f"{name}: must be numbers in metres of shape (P, 3)") from None
    if points.size == 0:
        points = points.reshape(0, 3)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError("cloud.shape", f"{name}: must be metres of shape (P, 3), got shape {points.shape}")
    bad = int((~np.isfinite(points)).any(axis=1).sum())
    if bad:
        raise MeshError(
            "cloud.nonfinite",
            f"{name}: {bad} of {len(points)} points are not finite (NaN or infinity); drop them first",
        )
    points.setflags(write=False)
    return points
