"""One block of cells on the device while its sub-apertures are added."""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Float
from waveformer.simulator.device import to_device, to_device_index
from waveformer.simulator.focus_cells import FocusCells
from waveformer.simulator.focus_tiles import FocusTile
from waveformer.simulator.kernel_factorised import Antennas
from waveformer.simulator.kernel_focus import FOCUS_MOMENTS, Columns, add_columns, collect_moments
from waveformer.simulator.radar import Aperture
from waveformer.simulator.range_bins import RangeBins


class Launched(NamedTuple):
    """Rows of a tile at work on the device.

    Attributes:
        tile, rows: which.
        at_antennas: moments of every cell at every antenna, as `collect_moments` gives them.
    """

    tile: FocusTile
    rows: slice
    at_antennas: list[Float]


class BlockFocus:
    """Sums over sub-apertures for the voxels of a block.

    Args:
        cells: the voxels.
        ranges: range bins about the middle of the block.
        aperture: N pairs.
        axes: components of the antenna positions that the contributions are also summed with.
    """

    def __init__(
        self, cells: FocusCells, ranges: RangeBins, aperture: Aperture, axes: tuple[int, ...]
    ) -> None:
        self._ranges, self._aperture, self._axes = ranges, aperture, axes
        self._num_cells = len(cells.centers_m)
        self._centers = to_device(cells.centers_m - ranges.center_m)
        cell = to_device_index(cells.cell)
        centers = dr.gather(Array3f, to_device(cells.centers_m), cell)
        x, y = to_device(cells.x_m), to_device(cells.y_m)
        self._columns = Columns(cell, centers, x, y, [to_device(along) for along in cells.z_m])
        count = len(cells.z_m) * (2 + 2 * len(axes))
        self._sums = [dr.zeros(Float, len(cells.cell)) for _ in range(count)]
        self._moments: NDArray[np.float32] | None = None

    def launch(self, tile: FocusTile, rows: slice, bins: NDArray[np.complex64]) -> Launched:
        """Begin with some rows of a tile, given the adjoint of their range bins (n, count * moments)."""
        members = tile.rows[rows]
        center_m, rx_m = self._ranges.center_m, self._aperture.rx_m
        antennas = Antennas(
            self._aperture.tx_m[members] - center_m, None if rx_m is None else rx_m[members] - center_m
        )
        return Launched(tile, rows, collect_moments(bins, self._ranges, antennas, self._centers))

    def merge(self, launched: Launched) -> None:
        """Merge what was launched into the nodes of its tile; the last rows of a tile add it to the image."""
        tile, rows, at_antennas = launched
        if self._moments is None:
            shape = (self._num_cells, len(tile.nodes_m[0]), 2 * FOCUS_MOMENTS)
            self._moments = np.zeros(shape, dtype=np.float32)
        for moment, values in enumerate(at_antennas):
            of_cells = values.numpy().reshape(-1, self._num_cells).T
            if tile.weights is None:
                self._moments[:, rows, moment] = of_cells
            else:
                self._moments[:, :, moment] += of_cells @ tile.weights[rows]
        if rows.stop >= len(tile.rows):
            self._sums = add_columns(
                self._sums, self._columns, tile.nodes_m, self._moments, self._ranges, self._axes
            )
            self._moments = None

    def sums(self) -> NDArray[np.float32]:
        """Sums of every voxel, shape (2 + 2 axes, L, C)."""
        length = len(self._columns.z)
        return (
            np.stack([value.numpy() for value in self._sums])
            .reshape(length, -1, dr.width(self._columns.cell))
            .swapaxes(0, 1)
        )
