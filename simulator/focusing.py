"""Imaging at scale: the image of a scan and the field of surface normals, in one pass over sub-apertures.

    image    S(v) = sum_k s_k(v),  s_k(v) = sum_t h[k, t] exp(+j 4 pi f_t R_kv / c)                  (Eq. 1)
    normals  N(v) = sum_k Re(s_k conj(S)) / |S| (p_k - v) = Re(conj(S) / |S| sum_k s_k p_k) - v |S|    (mmNorm)

Voxels form cells of 3.2 wavelengths, antennas form sub-apertures. Towards a cell, freed of the carrier to its centre,
the contributions of a sub-aperture are smooth in the antenna's place, so they are merged into a few nodes, and
only nodes meet voxels. Both s_k and s_k p_k are sums over nodes, the second with the nodes' places.

Bound of the error, relative to sum_k |s_k|: the tolerance for the nodes, and 2 (x/2)^3 / 3! for three moments in range,
with x the phase at the ends of the band over a cell (0.7 rad and 0.015 for 4 GHz). The exact twin is
`direct_image`, in float64 `reference_focus.dense_focus`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.blas import single_blas_thread
from waveformer.simulator.errors import RadarError
from waveformer.simulator.focus_cells import CELLS_PER_BLOCK_EDGE, FocusCells, focus_cells
from waveformer.simulator.focus_tiles import FocusTile, focus_tiles
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.range_bins import RangeBins, range_bins, reference_phase
from waveformer.simulator.runtime import activate

TOLERANCE = 0.1
CELL_EDGE_WAVELENGTHS = 3.2
_BIN_WIDTH_WAVELENGTHS = 0.5
# (antenna, cell) pairs of one launch: 48 MB.
_MAX_LANES = 2_000_000
# Antennas whose heights differ by less count as a plane: normals then need two sums instead of three.
_PLANE_M = 1e-4


@dataclass(frozen=True, eq=False)
class Focus:
    """An image and its normals.

    Attributes:
        grid: the voxels.
        image: S, shape (X, Y, Z) complex64; zero where it was not asked for.
        normals: unit vectors towards the radar, shape (X, Y, Z, 3) float32; NaN where S is zero or was not asked for;
            None if no normals were asked for.
    """

    grid: Grid
    image: NDArray[np.complex64]
    normals: NDArray[np.float32] | None


def focus(
    measurement: Measurement,
    grid: Grid,
    *,
    normals: bool = True,
    where: NDArray[np.bool_] | None = None,
    cells_per_edge: int = CELLS_PER_BLOCK_EDGE,
    progress: Callable[[int, int], None] | None = None,
) -> Focus:
    """Image of a scan and its field of normals, block by block.

    The known range bias of the measurement is taken out. Nothing is windowed or normalised.

    Args:
        measurement: h of shape (N, T).
        grid: voxels, any size: memory is that of a block.
        normals: whether to find normals, too.
        where: voxels that are wanted, shape (X, Y, Z); the work goes with the cells that they touch.
        cells_per_edge: cells along the edge of a block; the image does not depend on it beyond rounding.
        progress: called with (blocks done, blocks in all).

    Raises:
        RadarError: h holds non-finite samples, or `where` does not fit the grid.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    if not np.isfinite(measurement.h).all():
        raise RadarError("h holds non-finite samples: image only what was recorded whole")
    if where is not None and where.shape != grid.shape:
        raise RadarError(f"where has shape {where.shape}, the grid {grid.shape}")
    activate()
    wavelength_m = SPEED_OF_LIGHT_M_PER_S / measurement.chirp.center_hz
    axes = summed_axes(measurement) if normals else ()
    sums = np.zeros((2 + 2 * len(axes), int(np.prod(grid.shape))), dtype=np.float32)
    blocks = list(focus_cells(grid, CELL_EDGE_WAVELENGTHS * wavelength_m, where, cells_per_edge))
    for done, cells in enumerate(blocks):
        block = _focus_block(measurement, cells, axes)
        inside = cells.voxels >= 0
        sums[:, cells.voxels[inside]] = block[:, inside]
        if progress is not None:
            progress(done + 1, len(blocks))
    image = (sums[0] + 1j * sums[1]).reshape(grid.shape)
    return Focus(grid, image, normals_of(measurement, grid, sums, axes) if normals else None)


def _focus_block(measurement: Measurement, cells: FocusCells, axes: tuple[int, ...]) -> NDArray[np.float32]:
    """Sums of every voxel of a block, shape (2 + 2 axes, L, C)."""
    from waveformer.simulator.focus_block import BlockFocus
    from waveformer.simulator.kernel_focus import FOCUS_MOMENTS

    chirp, aperture = measurement.chirp, measurement.aperture
    low, high = cells.centers_m.min(axis=0), cells.centers_m.max(axis=0)
    center_m = 0.5 * (low + high)
    radius_m = float(np.linalg.norm(cells.centers_m - center_m, axis=1).max())
    ranges = range_bins(
        chirp, center_m, radius_m, cells.radius_m, _BIN_WIDTH_WAVELENGTHS, num_moments=FOCUS_MOMENTS
    )
    antennas = np.concatenate([aperture.tx_m, aperture.receivers_m])
    outside = np.maximum(0.0, np.maximum(low - antennas, antennas - high))
    # an antenna among the voxels leaves no smoothness to use: sub-apertures shrink to single positions
    closest_m = max(float(np.linalg.norm(outside, axis=1).min()) - cells.radius_m, 1e-4)
    tiles = focus_tiles(aperture, closest_m, cells.radius_m, float(chirp.wavelengths_m[-1]), TOLERANCE)
    block = BlockFocus(cells, ranges, aperture, axes)
    parts = [(tile, rows) for tile in tiles for rows in _parts(tile, len(cells.centers_m))]
    with single_blas_thread():
        launched = None
        for tile, rows in parts:
            following = block.launch(tile, rows, _range_bins_of(measurement, tile.rows[rows], ranges))
            if launched is not None:  # the device works on what follows while this is merged
                block.merge(launched)
            launched = following
        if launched is not None:
            block.merge(launched)
    return block.sums()


def _parts(tile: FocusTile, num_cells: int) -> Iterator[slice]:
    """Rows of a tile, so many at a time as one launch takes."""
    step = max(1, _MAX_LANES // num_cells)
    for first in range(0, len(tile.rows), step):
        yield slice(first, first + step)


def _range_bins_of(
    measurement: Measurement, rows: NDArray[np.int64], ranges: RangeBins
) -> NDArray[np.complex64]:
    """Adjoint of the range bins of some antennas, shape (n, count * moments), known bias taken out."""
    chirp = measurement.chirp
    h = measurement.h[rows] * measurement.bias_correction.astype(np.complex64)
    h *= reference_phase(chirp, measurement.aperture, rows, ranges.center_m).conj()
    return np.asarray(h @ ranges.to_samples.conj().T)


def summed_axes(measurement: Measurement) -> tuple[int, ...]:
    """Components of the antenna positions that differ between antennas."""
    middles = 0.5 * (measurement.aperture.tx_m + measurement.aperture.receivers_m)
    return (0, 1) if np.ptp(middles[:, 2]) < _PLANE_M else (0, 1, 2)


def normals_of(
    measurement: Measurement, grid: Grid, sums: NDArray[np.float32], axes: tuple[int, ...]
) -> NDArray[np.float32]:
    """Unit normals from S and the sums of s p, shape (X, Y, Z, 3)."""
    magnitude = np.hypot(sums[0], sums[1])
    normals = np.empty((magnitude.size, 3), dtype=np.float32)
    coordinates = np.meshgrid(grid.x, grid.y, grid.z, indexing="ij", sparse=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        for axis, coordinate in enumerate(coordinates):
            if axis in axes:
                place = 2 + 2 * axes.index(axis)
                voted = (sums[0] * sums[place] + sums[1] * sums[place + 1]) / magnitude
            else:  # one height for all antennas
                voted = magnitude * np.float32(measurement.aperture.tx_m[0, axis])
            towards = voted.reshape(grid.shape) - coordinate.astype(np.float32) * magnitude.reshape(
                grid.shape
            )
            normals[:, axis] = towards.reshape(-1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[magnitude == 0.0] = np.nan
    return normals.reshape(*grid.shape, 3)
