"""The surface that a cloud sweeps on its way down to a plane: walls below its outline, and the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

_NEIGHBOURS = np.ones((3, 3), dtype=bool)
# Axis and direction of the four sides of a column.
_SIDES = ((0, -1), (0, 1), (1, -1), (1, 1))


@dataclass(frozen=True, eq=False)
class Columns:
    """A cloud sorted into square columns over a plane.

    Attributes:
        corner_m: lower x and y of column [0, 0], shape (2,).
        cell_m: width of a column.
        plane_z_m: height of the plane.
        occupied: columns with points, and gaps of one column between them, (X, Y), empty at the border.
        height_m: lowest point of every column over the plane, of gaps that of their neighbours; at least 0.
    """

    corner_m: NDArray[np.float64]
    cell_m: float
    plane_z_m: float
    occupied: NDArray[np.bool_]
    height_m: NDArray[np.float64]

    @classmethod
    def of_cloud(cls, points_m: NDArray[np.float64], plane_z_m: float, cell_m: float) -> Columns:
        """The columns of at least one point (P, 3)."""
        corner_m = points_m[:, :2].min(axis=0) - cell_m
        column = np.floor((points_m[:, :2] - corner_m) / cell_m).astype(np.int64)
        lowest_m = np.full(column.max(axis=0) + 2, np.inf)
        np.minimum.at(lowest_m, tuple(column.T), points_m[:, 2])
        occupied = ndimage.binary_closing(np.isfinite(lowest_m), _NEIGHBOURS)
        nearby_m = ndimage.minimum_filter(lowest_m, footprint=_NEIGHBOURS)
        height_m = np.where(np.isfinite(lowest_m), lowest_m, nearby_m) - plane_z_m
        height_m = np.where(occupied, np.maximum(height_m, 0.0), 0.0)
        return cls(corner_m, cell_m, plane_z_m, occupied, height_m)

    @property
    def footprint_m2(self) -> float:
        """Area of all columns."""
        return float(self.occupied.sum()) * self.cell_m**2

    def walls_and_floor(self) -> SweptSurface:
        """A wall on every side of a column whose neighbour there is empty, and the plane below all columns."""
        patches = [self._floor(), *(self._walls(axis, side) for axis, side in _SIDES)]
        return SweptSurface(*(np.concatenate(parts) for parts in zip(*patches, strict=True)))

    def _floor(self) -> tuple[NDArray[np.float64], ...]:
        cells = np.argwhere(self.occupied)
        edges = np.full((len(cells), 1), self.cell_m)
        return self._corners(cells), edges * [1, 0, 0], edges * [0, 1, 0]

    def _walls(self, axis: int, side: int) -> tuple[NDArray[np.float64], ...]:
        cells = np.argwhere(self.occupied & ~np.roll(self.occupied, -side, axis=axis))
        corners = self._corners(cells)
        corners[:, axis] += self.cell_m * (side > 0)
        across = np.zeros((len(cells), 3))
        across[:, 1 - axis] = self.cell_m
        return corners, across, self.height_m[tuple(cells.T)][:, None] * [0, 0, 1]

    def _corners(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Lower corner of columns on the plane, (n, 3)."""
        level = np.full((len(cells), 1), self.plane_z_m)
        return np.concatenate([self.corner_m + self.cell_m * cells, level], axis=1)


@dataclass(frozen=True, eq=False)
class SweptSurface:
    """Rectangles.

    Attributes:
        corners_m: one corner of each, (n, 3).
        across_m, up_m: the two edges from there, (n, 3).
    """

    corners_m: NDArray[np.float64]
    across_m: NDArray[np.float64]
    up_m: NDArray[np.float64]

    @property
    def areas_m2(self) -> NDArray[np.float64]:
        """Of every rectangle, (n,)."""
        return np.asarray(np.linalg.norm(self.across_m, axis=1) * np.linalg.norm(self.up_m, axis=1))

    def sample(self, count: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Random points, even by area, (count, 3)."""
        areas = self.areas_m2
        chosen = rng.choice(len(areas), count, p=areas / areas.sum())
        along = rng.random((2, count, 1))
        on_plane = self.corners_m[chosen] + along[0] * self.across_m[chosen]
        return np.asarray(on_plane + along[1] * self.up_m[chosen])
