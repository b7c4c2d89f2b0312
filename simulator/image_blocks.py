"""One block of voxels and its linear map to the range bins of a tile, forwards and transposed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Float, UInt32
from waveformer.simulator.device import to_device, to_device_index, to_device_vectors
from waveformer.simulator.kernel_factorised import Antennas, deposit_cells
from waveformer.simulator.kernel_points import collect_cells, point_moments, points_from_moments
from waveformer.simulator.radar import Aperture
from waveformer.simulator.range_bins import NUM_MOMENTS
from waveformer.simulator.subapertures import Tile

if TYPE_CHECKING:
    from waveformer.simulator.imaging import GridBlock


class BlockOperator:
    """The block's voxels on the device.

    Args:
        block: the voxels.
        aperture: N pairs.
    """

    def __init__(self, block: GridBlock, aperture: Aperture) -> None:
        self._block, self._aperture = block, aperture
        self._offsets = to_device_vectors(block.offsets_m)
        self._cell = to_device_index(block.cell)
        self._cell_centers = to_device(block.centers_m - block.ranges.center_m)
        self._every_cell = dr.arange(UInt32, len(block.centers_m))
        self._voxel_centers = dr.gather(Array3f, to_device(block.centers_m), self._cell)
        self._real = dr.zeros(Float, len(block.cell))
        self._imaginary = dr.zeros(Float, len(block.cell))

    def forward(self, tile: Tile, amplitudes: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Range bins of a tile (n, count * NUM_MOMENTS) from the voxels' amplitudes (V,)."""
        block, ranges = self._block, self._block.ranges
        moments = point_moments(
            self._offsets,
            to_device(amplitudes.real),
            to_device(amplitudes.imag),
            to_device_index(block.starts[:-1]),
            to_device_index(block.starts[1:]),
            block.centers_m,
            _nodes(tile),
            ranges,
        )
        if tile.weights is not None:
            moments = tile.weights @ moments  # (n, M) @ (., M, Q)
        bins = dr.zeros(Float, len(tile.rows) * ranges.count * 2 * NUM_MOMENTS)
        flat = [to_device(moment) for moment in moments]
        deposit_cells(bins, ranges, flat, self._antennas(tile), self._every_cell, self._cell_centers)
        packed = np.ascontiguousarray(bins.numpy(), dtype=np.float32)
        return packed.view(np.complex64).reshape(len(tile.rows), -1)

    def add_adjoint(self, tile: Tile, bins: NDArray[np.complex64]) -> None:
        """Add the adjoint of `forward` to the image."""
        moments = collect_cells(
            bins, self._block.ranges, self._antennas(tile), self._every_cell, self._cell_centers
        )
        if tile.weights is not None:
            moments = tile.weights.T @ moments  # (M, n) @ (., n, Q)
        self._real, self._imaginary = points_from_moments(
            self._real,
            self._imaginary,
            self._offsets,
            self._cell,
            self._voxel_centers,
            moments.transpose(2, 1, 0),
            _nodes(tile),
            self._block.ranges,
        )

    def image(self) -> NDArray[np.complex64]:
        """The image so far, shape (V,)."""
        values = np.empty(len(self._block.cell), dtype=np.complex64)
        values.real, values.imag = self._real.numpy(), self._imaginary.numpy()
        return values

    def _antennas(self, tile: Tile) -> Antennas:
        center, rx = self._block.ranges.center_m, self._aperture.rx_m
        return Antennas(
            self._aperture.tx_m[tile.rows] - center, None if rx is None else rx[tile.rows] - center
        )


def _nodes(tile: Tile) -> list[NDArray[np.float64]]:
    return [tile.node_tx_m] if tile.node_rx_m is None else [tile.node_tx_m, tile.node_rx_m]
