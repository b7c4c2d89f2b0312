"""The plan of the fast kernel for one target: cells, moment scale, range bins, and batches of tiles.

Shared by the Dr.Jit kernel and its NumPy twin; holds no arithmetic of the echo itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.clusters import Cells, group_into_cells
from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp
from waveformer.simulator.range_bins import RangeBins, range_bins
from waveformer.simulator.subapertures import Tile
from waveformer.simulator.visibility import TileVisibility

CELL_EDGE_WAVELENGTHS = 2.0


@dataclass(frozen=True)
class Factorisation:
    """How the samples of one target are grouped and how range is binned.

    Attributes:
        samples: S samples, sorted cell by cell.
        cells: their cells; `starts` indexes the sorted samples.
        cell_of_sample: shape (S,).
        taper: facet form factor scale of every sample, shape (S,).
        ranges: range bins about the target's centre.
    """

    samples: SurfaceSamples
    cells: Cells
    cell_of_sample: NDArray[np.int64]
    taper: NDArray[np.float64]
    ranges: RangeBins


def factorise(
    samples: SurfaceSamples, chirp: Chirp, *, facet_taper: bool
) -> tuple[Factorisation, NDArray[np.int64]]:
    """Group the samples of one target for the factorised kernel.

    Returns:
        The plan, and the order in which it holds the given samples.
    """
    cells = group_into_cells(
        samples.points_m, CELL_EDGE_WAVELENGTHS * SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    )
    ordered = take(samples, cells.order)
    center = 0.5 * (ordered.points_m.min(axis=0) + ordered.points_m.max(axis=0))
    radius = float(np.sqrt(((ordered.points_m - center) ** 2).sum(axis=1).max()))
    ranges = range_bins(chirp, center, radius, cells.radius_m)
    plan = Factorisation(
        samples=ordered,
        cells=cells,
        cell_of_sample=np.repeat(np.arange(len(cells)), np.diff(cells.starts)),
        taper=taper_scale(ordered, ranges.wavelength_m, facet_taper),
        ranges=ranges,
    )
    return plan, cells.order


def taper_scale(samples: SurfaceSamples, wavelength_m: float, facet_taper: bool) -> NDArray[np.float64]:
    """(2 k)^2 * variance / 8 of every sample, so that (1 - scale * sin^2)^4 ~ exp(-x / 2); or zeros."""
    return (4.0 * np.pi / wavelength_m) ** 2 * samples.spread_m2 / 8.0 * float(facet_taper)


@dataclass(frozen=True)
class TileWork:
    """The cells one tile has to evaluate.

    Attributes:
        tile: the antennas.
        cells: cells with at least one wholly lit sample, the fullest first, shape (A,).
        members: those samples, cell by cell.
        first, last: range of `members` of every cell, shape (A,).
        visibility: for the partly lit samples.
    """

    tile: Tile
    cells: NDArray[np.int64]
    members: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    visibility: TileVisibility


def tile_work(plan: Factorisation, tile: Tile, visibility: TileVisibility) -> TileWork:
    """List the lit cells of a tile; equally full cells side by side keep vector lanes busy."""
    counts = np.bincount(plan.cell_of_sample[visibility.lit], minlength=len(plan.cells))
    last = np.cumsum(counts)
    cells = np.argsort(-counts, kind="stable")[: int(np.count_nonzero(counts))]
    return TileWork(tile, cells, visibility.lit, (last - counts)[cells], last[cells], visibility)
