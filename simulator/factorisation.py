"""The plan of the fast kernel for one target: cells, moment scale, range bins, and batches of tiles.

Shared by the Dr.Jit kernel and its NumPy twin; holds no arithmetic of the echo itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.box_crossings import leaving_changes, meets_box
from waveformer.simulator.clusters import Cells, group_into_cells
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, RangeBins, range_bins
from waveformer.simulator.response_plan import Crossings
from waveformer.simulator.subapertures import Tile
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.visibility import TileVisibility


@dataclass(frozen=True)
class Factorisation:
    """How the samples of one target are grouped and how range is binned.

    Attributes:
        samples: S samples, sorted cell by cell.
        cells: their cells; `starts` indexes the sorted samples.
        cell_of_sample: shape (S,).
        taper: facet form factor scale of every sample, shape (S,).
        ranges: range bins about the target's centre.
        lone_moments: moments in range of samples that are summed alone, 2 or 4.
    """

    samples: SurfaceSamples
    cells: Cells
    cell_of_sample: NDArray[np.int64]
    taper: NDArray[np.float64]
    ranges: RangeBins
    lone_moments: int


def factorise(
    samples: SurfaceSamples, chirp: Chirp, numerics: Numerics
) -> tuple[Factorisation, NDArray[np.int64]]:
    """Group the samples of one target for the factorised kernel.

    Returns:
        The plan, and the order in which it holds the given samples.
    """
    edge_m = numerics.cell_wavelengths * SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    cells = group_into_cells(samples.points_m, edge_m)
    return plan_cells(take(samples, cells.order), cells, chirp, numerics), cells.order


def plan_cells(samples: SurfaceSamples, cells: Cells, chirp: Chirp, numerics: Numerics) -> Factorisation:
    """The plan of samples that already lie cell by cell."""
    center = 0.5 * (samples.points_m.min(axis=0) + samples.points_m.max(axis=0))
    radius = float(np.sqrt(((samples.points_m - center) ** 2).sum(axis=1).max()))
    ranges = range_bins(chirp, center, radius, cells.radius_m, numerics.bin_wavelengths)
    return Factorisation(
        samples=samples,
        cells=cells,
        cell_of_sample=np.repeat(np.arange(len(cells)), np.diff(cells.starts)),
        taper=taper_scale(samples, ranges.wavelength_m, numerics.facet_taper),
        ranges=ranges,
        # half a bin turns by 0.14 rad over half of 3.6 GHz: two terms leave 5e-3 of the few that lie there
        lone_moments=2 if numerics.tolerance >= 1e-3 else NUM_MOMENTS,
    )


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
        frequency: entry of the response's frequencies.
        node_share: how much of each member each node of the tile sees, shape (M, len(members)); None means all.
    """

    tile: Tile
    cells: NDArray[np.int64]
    members: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    visibility: TileVisibility
    frequency: int = 0
    node_share: NDArray[np.float32] | None = None


def tile_work(plan: Factorisation, tile: Tile, visibility: TileVisibility) -> TileWork:
    """List the lit cells of a tile; equally full cells side by side keep vector lanes busy."""
    counts = np.bincount(plan.cell_of_sample[visibility.lit], minlength=len(plan.cells))
    last = np.cumsum(counts)
    cells = np.argsort(-counts, kind="stable")[: int(np.count_nonzero(counts))]
    return TileWork(tile, cells, visibility.lit, (last - counts)[cells], last[cells], visibility)


def shadow_work(plan: Factorisation, tile: Tile, visibility: TileVisibility) -> TileWork:
    """The partly lit samples of a tile as cells that its nodes see in part."""
    nothing = np.empty(0, dtype=np.int64), np.empty((len(tile.ray_tx_m), 0), dtype=np.float16)
    work = tile_work(plan, tile, TileVisibility(visibility.partial, *nothing))
    return replace(work, node_share=tile.node_ray_weights @ visibility.partial_visible.astype(np.float32))


def uneven_samples(
    plan: Factorisation, tile: Tile, surroundings: Surroundings, crossings: Crossings, aperture: Aperture
) -> NDArray[np.bool_]:
    """Samples (S,) whose ways to the antennas of a tile may cross different walls of the box."""
    box = surroundings.box
    if box is None or crossings == "none":
        return np.zeros(len(plan.cell_of_sample), dtype=bool)
    antennas = np.concatenate([aperture.tx_m[tile.rows], aperture.receivers_m[tile.rows]])
    changes = leaving_changes if crossings == "leaving" else meets_box
    return changes(box, plan.cells.centers_m, plan.cells.radius_m, antennas)[plan.cell_of_sample]


def turning_samples(plan: Factorisation, tile: Tile, aperture: Aperture) -> NDArray[np.bool_]:
    """Samples (S,) that some antennas of a tile face and others do not.

    Their echo has a kink there, with pairs a step where one of the two antennas sets first: nodes would smooth it.
    """
    turning = np.zeros(len(plan.cell_of_sample), dtype=bool)
    if tile.weights is None:  # every antenna is its own node
        return turning
    normals = plan.samples.normals
    height = np.einsum("ij,ij->i", normals, plan.samples.points_m)
    for side in (aperture.tx_m, aperture.receivers_m):
        antennas = side[tile.rows]
        ends = normals * antennas.min(axis=0), normals * antennas.max(axis=0)
        turning |= (np.minimum(*ends).sum(axis=1) < height) & (np.maximum(*ends).sum(axis=1) > height)
    return turning


def set_apart(visibility: TileVisibility, chosen: NDArray[np.bool_]) -> TileVisibility:
    """The same visibility, but the chosen samples (S,) are summed antenna by antenna like partly lit ones."""
    moved = chosen[visibility.lit]
    if not moved.any():
        return visibility
    alone = visibility.lit[moved]
    everywhere = np.ones((len(visibility.partial_visible), len(alone)), dtype=np.float16)
    return TileVisibility(
        visibility.lit[~moved],
        np.concatenate([visibility.partial, alone]),
        np.concatenate([visibility.partial_visible, everywhere], axis=1),
    )
