"""The echo of one target by the factorised kernel: visibility, moments, interpolation, bins, samples."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import chain
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Float, UInt32
from waveformer.simulator.device import to_device, to_device_index
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.factorisation import (
    Factorisation,
    TileWork,
    factorise,
    set_apart,
    shadow_work,
    tile_work,
    uneven_samples,
)
from waveformer.simulator.kernel_factorised import (
    Antennas,
    NodeLanes,
    cell_moments,
    deposit_cells,
    deposit_samples,
)
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.quadrature import take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, reference_phase
from waveformer.simulator.response import Response
from waveformer.simulator.response_plan import ResponsePlan
from waveformer.simulator.subapertures import Tile, build_tiles
from waveformer.simulator.visibility import VisibilityMap

# Samples this close share the rays of the first look at visibility.
PATCH_WAVELENGTHS = 0.2
# Lanes of (node, cell) in one launch: wide enough for a few threads, small enough to overlap.
_MAX_LANES = 1 << 18


def fast_echo(
    scene: Any,
    source: EchoSource,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
    tile_positions: int | None,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Sum the echo of one target, tile by tile.

    Args:
        scene: Mitsuba scene that decides visibility.
        source: the target.
        chirp, aperture: the radar, N pairs and T samples.
        numerics: kernel settings.
        tile_positions: most antenna positions in flight at once; None leaves it to a memory bound.
        add: called with rows (n,) and a part of their echo (n, T), not yet multiplied by j / (4 pi), nor by W
            if the source leaves it out.
    """
    planned = plan_echo(scene, source, chirp, aperture, numerics)
    if planned is not None:
        sum_batches(*planned, source, chirp, aperture, tile_positions, add)


def plan_echo(
    scene: Any,
    source: EchoSource,
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
    traced = trace_source(scene, source, chirp, aperture, numerics)
    if traced is None:
        return None
    plan, _, visibility, tiles = traced
    return plan, _batches(plan, tiles, visibility, source.response, aperture, numerics.interpolate_shadows)


def trace_source(
    scene: Any,
    source: EchoSource,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
) -> tuple[Factorisation, NDArray[np.int64], VisibilityMap, list[Tile]] | None:
    """The samples that are seen at all, in cells, and the tiles of the aperture.

    Arguments as in `fast_echo`.

    Returns:
        The plan, which of the source's samples it holds, what is seen, and the tiles; None if nothing is seen.
    """
    visibility = VisibilityMap(
        scene,
        source.samples,
        source.two_sided,
        aperture,
        probe_spacing_m=source.closest_m * np.radians(numerics.probe_spacing_deg),
        patch_m=PATCH_WAVELENGTHS * SPEED_OF_LIGHT_M_PER_S / chirp.center_hz,
    )
    seen = np.flatnonzero(visibility.seen)
    if len(seen) == 0:
        return None
    plan, order = factorise(take(source.samples, seen), chirp, numerics)
    tiles = build_tiles(
        aperture,
        source.closest_m,
        plan.cells.radius_m,
        SPEED_OF_LIGHT_M_PER_S / float(chirp.frequencies_hz[-1]),
        numerics.tolerance,
        source.closest_m * np.radians(numerics.leaf_spacing_deg),
        0.0 if source.response is None else source.response.phase_per_radian,
    )
    return plan, seen[order], visibility.select(seen[order]), tiles


def sum_batches(
    plan: Factorisation,
    batches: Iterable[list[TileWork]],
    source: EchoSource,
    chirp: Chirp,
    aperture: Aperture,
    tile_positions: int | None,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Stages 1 to 4 over batches of tiles.

    Args:
        plan, batches: from `plan_echo`.
        source, chirp, aperture, tile_positions, add: as in `fast_echo`.
    """
    tables = SampleTables(plan)
    response = None if source.response is None else Response(source.response)

    def finish(work: TileWork, bins: Float) -> None:
        tile = work.tile
        flat = np.ascontiguousarray(bins.numpy(), dtype=np.float32)
        packed = flat.view(np.complex64).reshape(len(tile.rows), -1)
        filled = np.flatnonzero(packed.any(axis=0))
        used = slice(filled.min(initial=packed.shape[1]), filled.max(initial=-1) + 1)
        # stage 4: (n, bin * moment) @ (bin * moment, T), without the empty bins at both ends
        spectrum = packed[:, used] @ plan.ranges.to_samples[used]
        spectrum *= reference_phase(chirp, aperture, tile.rows, plan.ranges.center_m)
        if source.response is not None:
            spectrum *= source.response.to_samples[work.frequency].astype(np.complex64)
        add(tile.rows, spectrum)

    # Always one step behind: NumPy works on what is ready while the device threads work on what comes next.
    running: tuple[TileWork, Float] | None = None
    for batch, at_nodes in _one_behind(plan, tables, batches, source.two_sided, response):
        for work, moments in zip(batch, _by_tile(batch, at_nodes), strict=True):
            for tile in work.tile.split(tile_positions):
                part = replace(work, tile=tile)
                bins = _tile_bins(plan, tables, part, moments, aperture, source.two_sided, response)
                if running is not None:
                    finish(*running)
                running = (part, bins)
    if running is not None:
        finish(*running)


def _one_behind(
    plan: Factorisation,
    tables: SampleTables,
    batches: Iterable[list[TileWork]],
    two_sided: bool,
    response: Response | None,
) -> Iterator[tuple[list[TileWork], list[Float]]]:
    """Launch stage 1 of every batch as it comes, and hand it out when the next one has been launched."""
    waiting: tuple[list[TileWork], list[Float]] | None = None
    for batch in batches:
        launched = (batch, _moments_at_nodes(plan, tables, batch, two_sided, response))
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


class SampleTables:
    """Device tables of the samples, relative to their cell's centre and to the target's centre."""

    def __init__(self, plan: Factorisation) -> None:
        samples, center = plan.samples, plan.ranges.center_m
        tail = np.concatenate([samples.normals, samples.areas_m2[:, None], plan.taper[:, None]], axis=1)
        in_cell = samples.points_m - plan.cells.centers_m[plan.cell_of_sample]
        self.in_cells = to_device(np.concatenate([in_cell, tail], axis=1))
        self.in_target = to_device(np.concatenate([samples.points_m - center, tail], axis=1))
        self.cell_centers = to_device(plan.cells.centers_m - center)


def _batches(
    plan: Factorisation,
    tiles: list[Tile],
    visibility: VisibilityMap,
    response: ResponsePlan | None,
    aperture: Aperture,
    interpolate_shadows: bool,
) -> Iterator[list[TileWork]]:
    """The tiles with what they see, traced while they are taken."""
    frequencies = 1 if response is None else len(response.frequencies_hz)
    works = (look(plan, tile, visibility, response, aperture, interpolate_shadows) for tile in tiles)
    return in_batches(chain.from_iterable(works), frequencies)


def look(
    plan: Factorisation,
    tile: Tile,
    visibility: VisibilityMap,
    response: ResponsePlan | None,
    aperture: Aperture,
    interpolate_shadows: bool,
) -> Iterator[TileWork]:
    """What one tile sees, with its own rays; shadow edges that its nodes may see in part come apart."""
    seen = visibility.of_tile(tile)
    has_nodes = tile.weights is not None and tile.ray_shape is not None
    smooth = np.full(len(seen.partial), interpolate_shadows and has_nodes)
    if response is not None:
        uneven = uneven_samples(plan, tile, response.surroundings, response.crossings, aperture)
        smooth &= ~uneven[seen.partial]
        seen = set_apart(seen, uneven)
        smooth = np.pad(smooth, (0, len(seen.partial) - len(smooth)))  # those set apart come last
    if smooth.any():
        seen, shadows = seen.divide(smooth)
        yield shadow_work(plan, tile, shadows)
    yield tile_work(plan, tile, seen)


def in_batches(tiles: Iterable[TileWork], frequencies: int) -> Iterator[list[TileWork]]:
    """Gather tiles until the launch of their nodes is wide enough; a tile comes once a response frequency.

    What is seen in part has launches of its own.
    """
    batches: dict[bool, list[TileWork]] = {False: [], True: []}
    lanes = dict.fromkeys(batches, 0)
    for work in tiles:
        work_lanes = len(work.tile.node_tx_m) * len(work.cells)
        kind = work.node_share is not None
        for frequency in range(frequencies):
            if batches[kind] and lanes[kind] + work_lanes > _MAX_LANES:
                yield batches[kind]
                batches[kind], lanes[kind] = [], 0
            batches[kind].append(replace(work, frequency=frequency))
            lanes[kind] += work_lanes
    yield from (batch for batch in batches.values() if batch)


def _moments_at_nodes(
    plan: Factorisation,
    tables: SampleTables,
    batch: list[TileWork],
    two_sided: bool,
    response: Response | None,
) -> list[Float]:
    """Stage 1 for a batch of tiles; empty if none of them sees a cell whole."""
    lanes, members = node_lanes(plan, batch)
    if dr.width(members) == 0:
        return []
    moments = cell_moments(tables.in_cells, members, lanes, plan.ranges, two_sided, response)
    dr.eval(moments)  # all of them in one launch
    return moments


def node_lanes(plan: Factorisation, batch: list[TileWork]) -> tuple[NodeLanes, UInt32]:
    """The (node, cell) pairs of a batch of tiles, and the lit samples of their cells."""
    tile_tx, tile_rx = [work.tile.node_tx_m for work in batch], [work.tile.node_rx_m for work in batch]
    counts = [(len(work.tile.node_tx_m), len(work.cells)) for work in batch]
    members_before = np.cumsum([0, *(len(work.members) for work in batch)])
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
        frequency=to_device_index(
            np.concatenate(
                [np.full(n * c, work.frequency) for (n, c), work in zip(counts, batch, strict=True)]
            )
        ),
        **_shares(batch, counts, members_before),
    )
    return lanes, to_device_index(np.concatenate([work.members for work in batch]))


def _shares(
    batch: list[TileWork], counts: list[tuple[int, int]], members_before: NDArray[np.int64]
) -> dict[str, Any]:
    """Table of what nodes see of samples, and where in it the row of every lane begins, less its first member."""
    tables = [work.node_share for work in batch if work.node_share is not None]
    if not tables:
        return {}
    before = np.cumsum([0, *(table.size for table in tables)])
    begins = [
        np.repeat(start + np.arange(nodes) * table.shape[1] - members, cells)
        for table, start, (nodes, cells), members in zip(tables, before, counts, members_before, strict=False)
    ]
    # unsigned: a negative beginning wraps, and wraps back when the member is added
    wrapped = np.concatenate(begins).astype(np.int32).view(np.uint32)
    return {
        "shares": to_device(np.concatenate([table.ravel() for table in tables])),
        "share_begins": to_device_index(wrapped),
    }


def _tile_bins(
    plan: Factorisation,
    tables: SampleTables,
    work: TileWork,
    at_nodes: NDArray[np.float32],
    aperture: Aperture,
    two_sided: bool,
    response: Response | None,
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
            [to_device(moment) for moment in moments],
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
            plan.lone_moments,
            response,
            work.frequency,
        )
    dr.eval(bins)
    return bins
