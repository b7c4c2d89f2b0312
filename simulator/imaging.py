"""Backprojection (Eq. 1) and the operator it is the adjoint of.

    project      h[n, t] = sum_v x_v exp(-j 4 pi f_t R_nv / c)
    backproject  I_v     = sum_n sum_t h[n, t] exp(+j 4 pi f_t R_nv / c)          (Eq. 1)

with R the mean of the two ways. Both walk the grid in blocks of cells and the aperture in tiles, with the
stages of `kernel_factorised` in order for one and transposed for the other, so that <A x, y> = <x, A* y>
holds to rounding. The dense float64 twins are `reference.dense_project` and `reference.dense_backproject`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.blas import single_blas_thread
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import RangeBins, range_bins, reference_phase
from waveformer.simulator.runtime import activate
from waveformer.simulator.subapertures import Tile, build_tiles

TOLERANCE = 1e-3
CELL_EDGE_WAVELENGTHS = 2.5
_CELLS_PER_BLOCK_EDGE = 16


@dataclass(frozen=True, eq=False)
class GridBlock:
    """A box of voxels cut into cells, its voxels in cell order.

    Attributes:
        slices: where the block lies in the grid.
        order: C-order position in the block of every voxel, shape (V,).
        starts: first voxel of every cell, shape (Q + 1,).
        cell: cell of every voxel, shape (V,).
        centers_m: centres of the cells, shape (Q, 3).
        offsets_m: voxels relative to their cell's centre, shape (V, 3).
        ranges: range bins about the middle of the block.
        tiles: the aperture, cut for this block's distance and cell size.
    """

    slices: tuple[slice, slice, slice]
    order: NDArray[np.int64]
    starts: NDArray[np.int64]
    cell: NDArray[np.int64]
    centers_m: NDArray[np.float64]
    offsets_m: NDArray[np.float64]
    ranges: RangeBins
    tiles: list[Tile]

    @property
    def shape(self) -> tuple[int, ...]:
        """Voxels along x, y and z."""
        return tuple(part.stop - part.start for part in self.slices)


def backproject(
    measurement: Measurement, grid: Grid, *, progress: Callable[[int, int], None] | None = None
) -> NDArray[np.complex64]:
    """Image of a scan: Eq. 1 as printed, a plain sum over positions and samples.

    The known range bias of the measurement is taken out. Nothing is windowed or normalised.

    Args:
        measurement: h of shape (N, T).
        grid: voxels, any size: the work goes block by block.
        progress: called with (voxels done, voxels in all).

    Returns:
        Complex image, shape (X, Y, Z).

    Raises:
        RadarError: h holds non-finite samples.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    chirp, aperture = measurement.chirp, measurement.aperture
    if not np.isfinite(measurement.h).all():
        raise RadarError("h holds non-finite samples: image only what was recorded whole")
    activate()
    from waveformer.simulator.image_blocks import BlockOperator

    bias = measurement.bias_correction.astype(np.complex64)
    image = np.empty(grid.shape, dtype=np.complex64)
    done = 0
    for block in _with_one_blas_thread(grid_blocks(grid, chirp, aperture)):
        operator = BlockOperator(block, aperture)
        for tile in block.tiles:
            h = measurement.h[tile.rows] * bias
            h = h * reference_phase(chirp, aperture, tile.rows, block.ranges.center_m).conj()
            operator.add_adjoint(tile, np.asarray(h @ block.ranges.to_samples.conj().T, dtype=np.complex64))
        flat = np.empty(len(block.order), dtype=np.complex64)
        flat[block.order] = operator.image()
        image[block.slices] = flat.reshape(block.shape)
        done += len(flat)
        if progress is not None:
            progress(done, image.size)
    return image


def project(
    image: NDArray[np.complex64], grid: Grid, chirp: Chirp, aperture: Aperture
) -> NDArray[np.complex64]:
    """Echo of voxels of unit gain: the operator that `backproject` is the adjoint of.

    No spreading, no antenna: h[n, t] = sum_v image[v] exp(-j 4 pi f_t R_nv / c).

    Args:
        image: shape (X, Y, Z).
        grid: its voxels.
        chirp, aperture: the radar.

    Returns:
        Shape (N, T).
    """
    values = np.asarray(image)
    if values.shape != grid.shape:
        raise RadarError(f"image of shape {values.shape} does not fit the grid {grid.shape}")
    activate()
    from waveformer.simulator.image_blocks import BlockOperator

    h = np.zeros((len(aperture), chirp.num_samples), dtype=np.complex64)
    for block in _with_one_blas_thread(grid_blocks(grid, chirp, aperture)):
        operator = BlockOperator(block, aperture)
        amplitudes = values[block.slices].reshape(-1)[block.order]
        for tile in block.tiles:
            spectrum = operator.forward(tile, amplitudes) @ block.ranges.to_samples
            h[tile.rows] += spectrum * reference_phase(chirp, aperture, tile.rows, block.ranges.center_m)
    return h


def _with_one_blas_thread(blocks: Iterator[GridBlock]) -> Iterator[GridBlock]:
    with single_blas_thread():
        yield from blocks


def grid_blocks(grid: Grid, chirp: Chirp, aperture: Aperture) -> Iterator[GridBlock]:
    """Cut a grid into blocks of cells about 2.5 wavelengths wide; memory is that of one block."""
    wavelength = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    axes = (grid.x, grid.y, grid.z)
    cells = [_cut(axis, CELL_EDGE_WAVELENGTHS * wavelength) for axis in axes]
    for cuts in product(*(_even_runs(along) for along in cells)):
        yield _block(axes, list(cuts), chirp, aperture)


def _even_runs(cuts: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Cuts of one axis in runs of equally many cells, up to the block's edge."""
    num_cells = len(cuts) - 1
    num_runs = -(-num_cells // _CELLS_PER_BLOCK_EDGE)
    ends = np.linspace(0, num_cells, num_runs + 1).round().astype(int)
    return [cuts[start : stop + 1] for start, stop in pairwise(ends)]


def _cut(axis: NDArray[np.float64], edge_m: float) -> NDArray[np.int64]:
    """Where to cut an axis so that no piece exceeds the edge: indices from 0 to len(axis)."""
    cuts = [0]
    while cuts[-1] < len(axis):
        cuts.append(max(cuts[-1] + 1, int(np.searchsorted(axis, axis[cuts[-1]] + edge_m, side="left"))))
    return np.array(cuts)


def _block(
    axes: tuple[NDArray[np.float64], ...], cuts: list[NDArray[np.int64]], chirp: Chirp, aperture: Aperture
) -> GridBlock:
    slices = tuple(slice(int(cut[0]), int(cut[-1])) for cut in cuts)
    coordinates = [axis[part] for axis, part in zip(axes, slices, strict=True)]
    counts = [len(cut) - 1 for cut in cuts]
    along = [np.repeat(np.arange(count), np.diff(cut)) for count, cut in zip(counts, cuts, strict=True)]
    cell = (along[0][:, None, None] * counts[1] + along[1][:, None]) * counts[2] + along[2]
    order = np.argsort(cell.reshape(-1), kind="stable")
    cell = cell.reshape(-1)[order]
    points = np.stack(np.meshgrid(*coordinates, indexing="ij"), axis=-1).reshape(-1, 3)[order]
    middles = [0.5 * (axis[cut[:-1]] + axis[cut[1:] - 1]) for axis, cut in zip(axes, cuts, strict=True)]
    centers = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 3)
    offsets = points - centers[cell]
    cell_radius = float(np.linalg.norm(offsets, axis=1).max())
    low, high = points.min(axis=0), points.max(axis=0)
    center = 0.5 * (low + high)
    ranges = range_bins(chirp, center, float(np.linalg.norm(points - center, axis=1).max()), cell_radius)
    antennas = np.concatenate([aperture.tx_m, aperture.receivers_m])
    outside = np.maximum(0.0, np.maximum(low - antennas, antennas - high))
    # an antenna inside the block leaves no smoothness to use: its tiles shrink to single positions
    closest = max(float(np.linalg.norm(outside, axis=1).min()), 1e-4)
    wavelength = float(chirp.wavelengths_m[-1])
    return GridBlock(
        slices=(slices[0], slices[1], slices[2]),
        order=order,
        starts=np.searchsorted(cell, np.arange(len(centers) + 1)),
        cell=cell,
        centers_m=centers,
        offsets_m=offsets,
        ranges=ranges,
        tiles=build_tiles(aperture, closest, cell_radius, wavelength, TOLERANCE, np.inf),
    )
