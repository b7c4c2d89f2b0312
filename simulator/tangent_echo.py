"""The fast kernel in forward mode: how the echo changes along one direction of what it depends on.

For what is one number, or moves all antennas alike, a product of Jacobian and direction costs a few sums whatever
the number of samples: positions of the antennas, matter, walls. The stages are those of `fast_echo`; Dr.Jit carries
the direction through stages 1 and 3, stages 2 and 4 are linear.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Float
from waveformer.simulator.device import to_device, to_device_index
from waveformer.simulator.factorisation import Factorisation, TileWork
from waveformer.simulator.fast_echo import SampleTables, in_batches, node_lanes
from waveformer.simulator.kernel_factorised import Antennas, cell_moments, deposit_cells, deposit_samples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, reference_phase
from waveformer.simulator.response import Response
from waveformer.simulator.response_plan import ResponsePlan, WallChange


@dataclass(frozen=True, eq=False)
class Direction:
    """What changes, and how fast; what is None stays.

    Attributes:
        samples: velocities of point, normal, area and taper of every sample, shape (S, 8).
        transmitters_m, receivers_m: velocity that all of them share, shape (3,).
        matter: numbers that change, and their rates.
    """

    samples: NDArray[np.float64] | None = None
    transmitters_m: NDArray[np.float64] | None = None
    receivers_m: NDArray[np.float64] | None = None
    matter: tuple[tuple[WallChange, float], ...] = ()


def tangent_echo(
    plan: Factorisation,
    tiles: Iterable[TileWork],
    two_sided: bool,
    response_plan: ResponsePlan | None,
    chirp: Chirp,
    aperture: Aperture,
    direction: Direction,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Derivative of the echo along a direction.

    Args:
        plan, tiles, two_sided, response_plan, chirp, aperture: as in `adjoint_echo.adjoint_echo`.
        direction: what changes.
        add: called with rows (n,) and a part of their derivative (n, T), scaled as `fast_echo` does.
    """
    tables = SampleTables(plan)
    response = None if response_plan is None else Response(response_plan)
    closing = _closing_speed(plan, aperture, direction)
    wavenumber = 2.0 * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    for batch in in_batches(tiles, 1 if response_plan is None else len(response_plan.frequencies_hz)):
        moments = _moments_at_nodes(plan, tables, batch, two_sided, response, direction)
        for work, value in zip(batch, moments, strict=True):
            rows = work.tile.rows
            bins = _bins(plan, tables, work, value, aperture, two_sided, response, direction)
            spectra = bins @ plan.ranges.to_samples  # (echo and its derivative, n, T)
            # the reference phase turns as the antennas move
            change = spectra[1] - 1j * closing[rows, None] * wavenumber * spectra[0]
            change *= reference_phase(chirp, aperture, rows, plan.ranges.center_m)
            if response_plan is not None:
                change *= response_plan.to_samples[work.frequency]
            add(rows, change.astype(np.complex64))


def _closing_speed(plan: Factorisation, aperture: Aperture, direction: Direction) -> NDArray[np.float64]:
    """How fast the path by way of the reference point grows, shape (N,)."""
    speed = np.zeros(len(aperture))
    sides = [(aperture.tx_m, direction.transmitters_m)]
    if aperture.rx_m is None:
        sides *= 2  # there and back
    else:
        sides.append((aperture.rx_m, direction.receivers_m))
    for positions, motion in sides:
        if motion is not None:
            way = positions - plan.ranges.center_m
            speed += way @ motion / np.linalg.norm(way, axis=1)
    return speed


def _moving(table: Float, seed: Float, velocity: NDArray[np.float64] | None) -> Float:
    return table if velocity is None else table + seed * to_device(velocity)


def _along(response: Response | None, seed: Float, direction: Direction) -> Response | None:
    return response if response is None or not direction.matter else response.along(seed, direction.matter)


def _moments_at_nodes(
    plan: Factorisation,
    tables: SampleTables,
    batch: list[TileWork],
    two_sided: bool,
    response: Response | None,
    direction: Direction,
) -> list[NDArray[np.float32]]:
    """Stage 1: moments of every tile and their derivatives, (2, 2 * NUM_MOMENTS, nodes, cells)."""
    shapes = [(2, 2 * NUM_MOMENTS, len(work.tile.node_tx_m), len(work.cells)) for work in batch]
    lanes, members = node_lanes(plan, batch)
    if dr.width(members) == 0:
        return [np.empty(shape, np.float32) for shape in shapes]
    seed = dr.opaque(Float, 0.0)
    dr.enable_grad(seed)
    nodes = sum(shape[2] for shape in shapes)
    lanes = lanes._replace(
        transmitters=_moving(lanes.transmitters, seed, _repeated(direction.transmitters_m, nodes))
    )
    if lanes.receivers is not None:
        lanes = lanes._replace(
            receivers=_moving(lanes.receivers, seed, _repeated(direction.receivers_m, nodes))
        )
    moments = cell_moments(
        _moving(tables.in_cells, seed, direction.samples), members, lanes, plan.ranges, two_sided,
        _along(response, seed, direction),
    )  # fmt: skip
    dr.forward(seed)
    both = [dr.detach(moment) for moment in moments] + [dr.grad(moment) for moment in moments]
    dr.eval(both)
    stacked = np.stack([part.numpy() for part in both]).reshape(2, 2 * NUM_MOMENTS, -1)
    stops = np.cumsum([shape[2] * shape[3] for shape in shapes])[:-1]
    return [part.reshape(shape) for part, shape in zip(np.split(stacked, stops, axis=2), shapes, strict=True)]


def _repeated(velocity: NDArray[np.float64] | None, count: int) -> NDArray[np.float64] | None:
    return None if velocity is None else np.tile(velocity, count)


def _bins(
    plan: Factorisation,
    tables: SampleTables,
    work: TileWork,
    moments: NDArray[np.float32],
    aperture: Aperture,
    two_sided: bool,
    response: Response | None,
    direction: Direction,
) -> NDArray[np.complex64]:
    """Stages 2 and 3: range bins of a tile and their derivatives, (2, n, count * NUM_MOMENTS)."""
    rows, ranges, partial = work.tile.rows, plan.ranges, work.visibility.partial
    seed = dr.opaque(Float, 0.0)
    dr.enable_grad(seed)
    receivers = None if aperture.rx_m is None else aperture.rx_m[rows] - ranges.center_m
    antennas = Antennas(aperture.tx_m[rows] - ranges.center_m, receivers)
    antennas = antennas.along(seed, (direction.transmitters_m, direction.receivers_m))
    bins = dr.zeros(Float, len(rows) * ranges.count * 2 * NUM_MOMENTS)
    if len(work.cells):
        interpolated = moments if work.tile.weights is None else work.tile.weights @ moments
        values, slopes = interpolated
        moving = [_moving(to_device(v), seed, s) for v, s in zip(values, slopes, strict=True)]
        deposit_cells(bins, ranges, moving, antennas, to_device_index(work.cells), tables.cell_centers)
    if len(partial):
        deposit_samples(
            bins, ranges, _moving(tables.in_target, seed, direction.samples), to_device_index(partial), antennas,
            to_device(work.tile.ray_weights @ work.visibility.partial_visible), two_sided, plan.lone_moments,
            _along(response, seed, direction), work.frequency,
        )  # fmt: skip
    dr.forward(seed)
    both = [dr.detach(bins), dr.grad(bins)]
    dr.eval(both)
    flat = np.stack([np.ascontiguousarray(part.numpy(), dtype=np.float32) for part in both])
    return flat.view(np.complex64).reshape(2, len(rows), -1)
