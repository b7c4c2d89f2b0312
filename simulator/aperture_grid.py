"""Rows of an aperture that form a regular planar grid, whatever their order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError

# Positions of a grid lie this close to its lines, as a part of the pitch.
_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class ApertureGrid:
    """Which antenna stands where in a grid.

    Attributes:
        rows: row of the aperture at every place, shape (num_y, num_x).
    """

    rows: NDArray[np.int64]

    @classmethod
    def find(cls, tx_m: NDArray[np.float64], least: int) -> ApertureGrid:
        """The grid that the positions (N, 3) form.

        Args:
            tx_m: positions in any order.
            least: fewest positions along x and along y.

        Raises:
            RadarError: they form no regular grid along x and y in a plane of constant z, or a smaller one.
        """
        places, counts = [], []
        for axis in range(2):
            place, count = _places(tx_m[:, axis])
            places.append(place)
            counts.append(count)
        num_x, num_y = counts
        reach_m = float(np.ptp(tx_m[:, :2], axis=0).max())
        flat = float(np.ptp(tx_m[:, 2])) <= _TOLERANCE * reach_m
        if (
            not flat
            or num_x * num_y != len(tx_m)
            or len(np.unique(places[1] * num_x + places[0])) != len(tx_m)
        ):
            raise RadarError(
                f"tx_m must be a regular grid along x and y at one z, like Aperture.planar_grid; its {len(tx_m)} "
                "positions are not: take a part of the scan that is"
            )
        if min(num_x, num_y) < least:
            raise RadarError(
                f"tx_m is a grid of {num_x} x {num_y} positions, and at least {least} x {least} are needed"
            )
        rows = np.empty((num_y, num_x), dtype=np.int64)
        rows[places[1], places[0]] = np.arange(len(tx_m))
        return cls(rows)

    def thinned(self, per_axis: int) -> ApertureGrid:
        """Every n-th position along both axes, n being the largest that leaves at least `per_axis`, if there are."""
        steps = [max(1, (count - 1) // max(1, per_axis - 1)) for count in self.rows.shape]
        return ApertureGrid(self.rows[:: steps[0], :: steps[1]])

    def tile_labels(self, per_axis: int) -> NDArray[np.int64]:
        """Tile of every position, of `per_axis` x `per_axis` tiles, in the order of ``rows.ravel()``."""
        along = [np.arange(count) * per_axis // count for count in self.rows.shape]
        return np.asarray(along[0][:, None] * per_axis + along[1][None, :]).ravel()


def _places(values_m: NDArray[np.float64]) -> tuple[NDArray[np.int64], int]:
    """Index of every value on a line with equal steps, and how many steps; (anything, 0) if there is no such line."""
    ordered = np.sort(values_m)
    gaps = np.diff(ordered)
    wide = gaps[gaps > _TOLERANCE * gaps.max(initial=0.0)]
    if len(wide) == 0:
        return np.zeros(len(values_m), dtype=np.int64), 1
    steps = (values_m - ordered[0]) / (np.ptp(values_m) / len(wide))
    nearest = np.round(steps).astype(np.int64)
    return nearest, len(wide) + 1 if np.abs(steps - nearest).max() <= _TOLERANCE else 0
