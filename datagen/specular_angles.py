"""How far every point of a surface is from mirroring a sensor back to itself: the angle of Eq. 2.

The angle between a normal n and the directions to the places of a plane has one minimum and no other valley, since
the places within an angle theta < 90 degrees of n are the section of a plane and a convex cone. Two facts follow for a
grid, and with them a few of its sensors answer for all:

- on a line of the grid the best sensor is one of the two beside the best place, which has a closed form;
- lines get worse on either side of the one through the best place of the whole rectangle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.aperture_grid import ApertureGrid
from waveformer.simulator.errors import RadarError

_BLOCK_PAIRS = 1 << 22


class Alignment(NamedTuple):
    """The sensor that each point faces best.

    Attributes:
        angle_deg: between the normal and the direction to that sensor, (P,), 0 .. 180.
        sensor: its row, (P,).
    """

    angle_deg: NDArray[np.float64]
    sensor: NDArray[np.int64]


def specular_alignment(
    points_m: NDArray[np.float64], normals: NDArray[np.float64], sensors_m: NDArray[np.float64]
) -> Alignment:
    """The smallest angle over all sensors between a point's normal and the direction to the sensor (paper, Eq. 2).

    Args:
        points_m: (P, 3).
        normals: unit vectors, (P, 3).
        sensors_m: (N, 3); for pairs of a transmitter and a receiver the middle between them. A regular grid at one z,
            as `Aperture.planar_grid` and `Aperture.raster_rows` make it, takes milliseconds; of other arrangements
            every sensor is tried with every point.

    Returns:
        Exact for every sensor there is, to rounding; of equally good sensors any.
    """
    try:
        grid = ApertureGrid.find(sensors_m, least=1)
    except RadarError:
        return try_every_sensor(points_m, normals, sensors_m)
    return _GridSearch(points_m, normals, sensors_m, grid).result()


def try_every_sensor(
    points_m: NDArray[np.float64], normals: NDArray[np.float64], sensors_m: NDArray[np.float64]
) -> Alignment:
    """`specular_alignment` term by term."""
    cosine, sensor = np.empty(len(points_m)), np.empty(len(points_m), dtype=np.int64)
    step = max(1, _BLOCK_PAIRS // len(sensors_m))
    for start in range(0, len(points_m), step):
        block = slice(start, start + step)
        towards = sensors_m - points_m[block, None]  # (block, N, 3)
        along = np.einsum("pki,pi->pk", towards, normals[block]) / np.linalg.norm(towards, axis=2)
        sensor[block] = along.argmax(axis=1)
        cosine[block] = along.max(axis=1)
    return Alignment(_degrees(cosine), sensor)


class _GridSearch:
    """The best sensor of a grid so far, for every point."""

    def __init__(
        self,
        points_m: NDArray[np.float64],
        normals: NDArray[np.float64],
        sensors_m: NDArray[np.float64],
        grid: ApertureGrid,
    ) -> None:
        self.rows = grid.rows
        self.x, self.y = sensors_m[grid.rows[0], 0], sensors_m[grid.rows[:, 0], 1]
        self.px, self.py, depth = points_m.T
        self.nx, self.ny, nz = normals.T
        height = sensors_m[:, 2].mean() - depth
        self.height_squared, self.nz_height = height**2, nz * height
        self.best = np.full(len(points_m), -np.inf)
        self.best_i = np.zeros(len(points_m), dtype=np.int64)
        self.best_j = np.zeros(len(points_m), dtype=np.int64)

    def result(self) -> Alignment:
        # Where no sensor lies in front, the least bad one is a corner: seen from behind, angles have no inner maximum.
        every = np.arange(len(self.best))
        for i in (0, len(self.x) - 1):
            for j in (0, len(self.y) - 1):
                self._offer(every, np.full(len(every), i), np.full(len(every), j))
        front = np.flatnonzero(self.best > 0)
        first = np.searchsorted(self.y, self._best_place_y(front), side="right") - 1
        for start, step in ((first, -1), (first + 1, 1)):
            self._walk(front, start, step)
        return Alignment(_degrees(self.best), self.rows[self.best_j, self.best_i])

    def _walk(self, points: NDArray[np.int64], line: NDArray[np.int64], step: int) -> None:
        """Offer the lines from a first one on, until they cannot be better."""
        while True:
            inside = (line >= 0) & (line < len(self.y))
            points, line = points[inside], line[inside]
            x = self._best_x(points, self.y[line], self.x[0], self.x[-1])
            promising = self._cosine(points, x, self.y[line]) > self.best[points]
            points, line, x = points[promising], line[promising], x[promising]
            if len(points) == 0:
                return
            above = np.clip(np.searchsorted(self.x, x), 0, len(self.x) - 1)
            self._offer(points, above, line)
            self._offer(points, np.maximum(above - 1, 0), line)
            line = line + step

    def _best_place_y(self, points: NDArray[np.int64]) -> NDArray[np.float64]:
        """The y of the best place of the rectangle around all sensors: where the normal meets it, or on an edge."""
        (left, right), (low, high) = self.x[[0, -1]], self.y[[0, -1]]
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = self.height_squared[points] / self.nz_height[points]
            x, y = self.px[points] + reach * self.nx[points], self.py[points] + reach * self.ny[points]
        met = (reach > 0) & (x >= left) & (x <= right) & (y >= low) & (y <= high)
        found = np.where(met, y, low)
        points, best, best_y = points[~met], np.full(int((~met).sum()), -np.inf), found[~met]
        on_rows = [np.full(len(points), at) for at in (low, high)]
        on_columns = [np.full(len(points), at) for at in (left, right)]
        edges = [(self._best_x(points, y, left, right), y) for y in on_rows]
        edges += [(x, self._best_y(points, x, low, high)) for x in on_columns]
        for x, y in edges:
            cosine = self._cosine(points, x, y)
            better = cosine > best
            best, best_y = np.where(better, cosine, best), np.where(better, y, best_y)
        found[~met] = best_y
        return np.asarray(found)

    def _best_x(
        self, points: NDArray[np.int64], y: NDArray[np.float64], low: float, high: float
    ) -> NDArray[np.float64]:
        px, across = self.px[points], y - self.py[points]
        rest = self.ny[points] * across + self.nz_height[points]
        away_squared = across**2 + self.height_squared[points]
        return np.asarray(px + _best_on_line(self.nx[points], rest, away_squared, low - px, high - px))

    def _best_y(
        self, points: NDArray[np.int64], x: NDArray[np.float64], low: float, high: float
    ) -> NDArray[np.float64]:
        py, across = self.py[points], x - self.px[points]
        rest = self.nx[points] * across + self.nz_height[points]
        away_squared = across**2 + self.height_squared[points]
        return np.asarray(py + _best_on_line(self.ny[points], rest, away_squared, low - py, high - py))

    def _cosine(
        self, points: NDArray[np.int64], x: NDArray[np.float64], y: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        along_x, along_y = x - self.px[points], y - self.py[points]
        length = np.sqrt(along_x**2 + along_y**2 + self.height_squared[points])
        return np.asarray(
            (self.nx[points] * along_x + self.ny[points] * along_y + self.nz_height[points]) / length
        )

    def _offer(self, points: NDArray[np.int64], i: NDArray[np.int64], j: NDArray[np.int64]) -> None:
        cosine = self._cosine(points, self.x[i], self.y[j])
        better = cosine > self.best[points]
        points = points[better]
        self.best[points], self.best_i[points], self.best_j[points] = cosine[better], i[better], j[better]


def _best_on_line(
    slope: NDArray[np.float64],
    rest: NDArray[np.float64],
    distance_squared: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The w in low .. high at which (slope w + rest) / sqrt(w^2 + distance_squared) is largest, if it is positive there."""
    # Zero derivative at w = slope distance^2 / rest; without a positive rest it only grows, towards the slope's side.
    with np.errstate(divide="ignore", invalid="ignore"):
        peak = np.where(rest > 0, slope * distance_squared / rest, np.copysign(np.inf, slope))
    limited: NDArray[np.float64] = np.clip(peak, low, high)
    return limited


def _degrees(cosine: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))))
