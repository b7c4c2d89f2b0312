"""The echo of one target by the factorised kernel: visibility, moments, interpolation, bins, samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
from drjit.llvm.ad import Float
from numpy.typing import NDArray

from waveformer.simulator.device import to_device, to_device_index
from waveformer.simulator.factorisation import Factorisation, TileWork, factorise, tile_work
from waveformer.simulator.kernel_factorised import (
    Antennas,
    NodeLanes,
    cell_moments,
    deposit_cells,
    deposit_samples,
)
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, reference_phase
from waveformer.simulator.subapertures import Tile, build_tiles
from waveformer.simulator.visibility import VisibilityMap

# Samples this close share the rays of the first look at visibility.
PATCH_WAVELENGTHS = 0.2
# Lanes of (node, cell) in one launch: wide enough for a few threads, small enough to overlap.
_MAX_LANES = 1 << 18


def fast_echo(
    scene: Any,
    samples: SurfaceSamples,
    two_sided: bool,
    closest_m: float,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
    tile_positions: int | None,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Sum the echo of one target, tile by tile.

    Args:
        scene: Mitsuba scene that decides visibility.
        samples: surface samples of the target in the radar frame.
        two_sided: whether the back of the surface reflects.
        closest_m: smallest distance from an antenna to the target.
        chirp, aperture: the radar, N pairs and T samples.
        numerics: kernel settings.
        tile_positions: most antenna positions in flight at once; None leaves it to a memory bound.
        add: called with rows (n,) and their echo (n, T), not yet multiplied by j Gamma / (4 pi).
    """
    planned = plan_echo(scene, samples, two_sided, closest_m, chirp, aperture, numerics)
    if planned is not None:
        sum_batches(*planned, two_sided, chirp, aperture, tile_positions, add)


def plan_echo(
    scene: Any,
    samples: SurfaceSamples,
    two_sided: bool,
    closest_m: float,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
) -> tuple[Factorisation, Iterator[list[TileWork]]] | None:
    """Group samples and antennas and trace what sees what.

    Arguments as in `fast_echo`.

    Returns:
        The plan, and the tiles with what they see, traced while they are taken, in batches for one launch;
        None if no sample is seen.
    """
    visibility = VisibilityMap(
        scene,
        samples,
        two_sided,
        aperture,
        probe_spacing_m=closest_m * np.radians(numerics.probe_spacing_deg),
        patch_m=PATCH_WAVELENGTHS * SPEED_OF_LIGHT_M_PER_S / chirp.center_hz,
    )
    seen = np.flatnonzero(visibility.seen)
    if len(seen) == 0:
        return None
    plan, order = factorise(take(samples, seen), chirp, facet_taper=numerics.facet_taper)
    visibility = visibility.select(seen[order])
    tiles = build_tiles(
        aperture,
        closest_m,
        plan.cells.radius_m,
        SPEED_OF_LIGHT_M_PER_S / float(chirp.frequencies_hz[-1]),
        numerics.tolerance,
        closest_m * np.radians(numerics.leaf_spacing_deg),
    )
    return plan, _batches(plan, tiles, visibility)


def sum_batches(
    plan: Factorisation,
    batches: Iterable[list[TileWork]],
    two_sided: bool,
    chirp: Chirp,
    aperture: Aperture,
    tile_positions: int | None,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Stages 1 to 4 over batches of tiles.

    Args:
        plan, batches: from `plan_echo`.
        two_sided, chirp, aperture, tile_positions, add: as in `fast_echo`.
    """
    tables = _SampleTables(plan)

    def finish(tile: Tile, bins: Float) -> None:
        flat = np.ascontiguousarray(bins.numpy(), dtype=np.float32)
        packed = flat.view(np.complex64).reshape(len(tile.rows), -1)
        filled = np.flatnonzero(packed.any(axis=0))
        used = slice(filled.min(initial=packed.shape[1]), filled.max(initial=-1) + 1)
        # stage 4: (n, bin * moment) @ (bin * moment, T), without the empty bins at both ends
        spectrum = packed[:, used] @ plan.ranges.to_samples[used]
        add(tile.rows, spectrum * reference_phase(chirp, aperture, tile.rows, plan.ranges.center_m))

    # Always one step behind: NumPy works on what is ready while the device threads work on what comes next.
    running: tuple[Tile, Float] | None = None
    for batch, at_nodes in _one_behind(plan, tables, batches, two_sided):
        for work, moments in zip(batch, _by_tile(batch, at_nodes), strict=True):
            for tile in work.tile.split(tile_positions):
                bins = _tile_bins(plan, tables, replace(work, tile=tile), moments, aperture, two_sided)
                if running is not None:
                    finish(*running)
                running = (tile, bins)
    if running is not None:
        finish(*running)


def _one_behind(
    plan: Factorisation, tables: _SampleTables, batches: Iterable[list[TileWork]], two_sided: bool
) -> Iterator[tuple[list[TileWork], list[Float]]]:
    """Launch stage 1 of every batch as it comes, and hand it out when the next one has been launched."""
    waiting: tuple[list[TileWork], list[Float]] | None = None
    for batch in batches:
        launched = (batch, _moments_at_nodes(plan, tables, batch, two_sided))
        if waiting is not None:
            yield waiting
        waiting = launched
    if waiting is not None:
        yield waiting


def _by_tile(batch: list[TileWork], at_nodes: list[Float]) -> list[NDArray[np.float32]]:
    """Moments of a batch per tile, (2 * NUM_MOMENTS, nodes, cells)."""
    shapes = [(2 * NUM_MOMENTS, len(work.tile.node_tx_m), len(work.cells)) for work in batch]
    if not at_nodes:
        return [np.empty(shape, np.float32) for shape in shapes]
    moments = np.stack([part.numpy() for part in at_nodes])
    stops = np.cumsum([nodes * cells for _, nodes, cells in shapes])[:-1]
    return [part.reshape(shape) for part, shape in zip(np.split(moments, stops, axis=1), shapes, strict=True)]


class _SampleTables:
    """Device tables of the samples, relative to their cell's centre and to the target's centre."""

    def __init__(self, plan: Factorisation) -> None:
        samples, center = plan.samples, plan.ranges.center_m
        tail = np.concatenate([samples.normals, samples.areas_m2[:, None], plan.taper[:, None]], axis=1)
        in_cell = samples.points_m - plan.cells.centers_m[plan.cell_of_sample]
        self.in_cells = to_device(np.concatenate([in_cell, tail], axis=1))
        self.in_target = to_device(np.concatenate([samples.points_m - center, tail], axis=1))
        self.cell_centers = to_device(plan.cells.centers_m - center)


def _batches(plan: Factorisation, tiles: list[Tile], visibility: VisibilityMap) -> Iterator[list[TileWork]]:
    """Gather tiles until the launch of their nodes is wide enough."""
    batch: list[TileWork] = []
    lanes = 0
    for tile in tiles:
        work = tile_work(plan, tile, visibility.of_tile(tile))
        work_lanes = len(tile.node_tx_m) * len(work.cells)
        if batch and lanes + work_lanes > _MAX_LANES:
            yield batch
            batch, lanes = [], 0
        batch.append(work)
        lanes += work_lanes
    if batch:
        yield batch


def _moments_at_nodes(
    plan: Factorisation, tables: _SampleTables, batch: list[TileWork], two_sided: bool
) -> list[Float]:
    """Stage 1 for a batch of tiles; empty if none of them sees a cell whole."""
    tile_tx, tile_rx = [work.tile.node_tx_m for work in batch], [work.tile.node_rx_m for work in batch]
    counts = [(len(work.tile.node_tx_m), len(work.cells)) for work in batch]
    members_before = np.cumsum([0, *(len(work.members) for work in batch)])
    if members_before[-1] == 0:
        return []
    nodes_before = np.cumsum([0, *(nodes for nodes, _ in counts)])
    cells_before = np.cumsum([0, *(cells for _, cells in counts)])
    lanes = NodeLanes(
        node=to_device_index(
            np.concatenate(
                [np.repeat(np.arange(n) + s, c) for (n, c), s in zip(counts, nodes_before, strict=False)]
            )
        ),
        cell=to_device_index(
            np.concatenate(
                [np.tile(np.arange(c) + s, n) for (n, c), s in zip(counts, cells_before, strict=False)]
            )
        ),
        transmitters=to_device(np.concatenate(tile_tx)),
        receivers=None
        if tile_rx[0] is None
        else to_device(np.concatenate([rx for rx in tile_rx if rx is not None])),
        centers=to_device(np.concatenate([plan.cells.centers_m[work.cells] for work in batch])),
        first=to_device_index(
            np.concatenate([work.first + s for work, s in zip(batch, members_before, strict=False)])
        ),
        last=to_device_index(
            np.concatenate([work.last + s for work, s in zip(batch, members_before, strict=False)])
        ),
    )
    members = to_device_index(np.concatenate([work.members for work in batch]))
    return cell_moments(tables.in_cells, members, lanes, plan.ranges, two_sided)


def _tile_bins(
    plan: Factorisation,
    tables: _SampleTables,
    work: TileWork,
    at_nodes: NDArray[np.float32],
    aperture: Aperture,
    two_sided: bool,
) -> Float:
    """Stages 2 and 3 for one tile: its range bins, launched and not waited for."""
    rows, ranges, partial = work.tile.rows, plan.ranges, work.visibility.partial
    receivers = None if aperture.rx_m is None else aperture.rx_m[rows] - ranges.center_m
    antennas = Antennas(aperture.tx_m[rows] - ranges.center_m, receivers)
    bins = dr.zeros(Float, len(rows) * ranges.count * 2 * NUM_MOMENTS)
    if len(work.cells):
        moments = at_nodes if work.tile.weights is None else work.tile.weights @ at_nodes
        deposit_cells(
            bins,
            ranges,
            moments.reshape(2 * NUM_MOMENTS, -1),
            antennas,
            to_device_index(work.cells),
            tables.cell_centers,
        )
    if len(partial):
        deposit_samples(
            bins,
            ranges,
            tables.in_target,
            to_device_index(partial),
            antennas,
            to_device(work.tile.ray_weights @ work.visibility.partial_visible),
            two_sided,
        )
    dr.eval(bins)
    return bins
