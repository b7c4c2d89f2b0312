"""The fast kernel transposed: from the gradient of a signal to that of the surface samples.

The stages of `fast_echo` in reverse order. Stages 4, 3 and 2 are linear: samples to bins, bins to moments of cells at
antennas, antennas to nodes. Stage 1 is `kernel_adjoint`. A signal gradient follows torch's convention: for a
loss L it is dL / d Re h + j dL / d Im h, so dL = Re sum conj(gradient) dh.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Float, UInt32
from waveformer.simulator.device import to_device, to_device_index
from waveformer.simulator.factorisation import Factorisation, TileWork
from waveformer.simulator.fast_echo import SampleTables
from waveformer.simulator.kernel_adjoint import SAMPLE_FLOATS, AdjointLanes, sample_adjoint
from waveformer.simulator.kernel_factorised import Antennas
from waveformer.simulator.kernel_points import collect_cells
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.range_bins import reference_phase
from waveformer.simulator.response import Response
from waveformer.simulator.response_plan import ResponsePlan


def adjoint_echo(
    plan: Factorisation,
    tiles: Iterable[TileWork],
    two_sided: bool,
    response_plan: ResponsePlan | None,
    chirp: Chirp,
    aperture: Aperture,
    gradient: NDArray[np.complex64],
) -> NDArray[np.float64]:
    """Gradient of a loss by the samples, from its gradient by their echo as `fast_echo` hands it out.

    Args:
        plan: cells and bins of the target.
        tiles: every tile once, with what it sees.
        two_sided: whether the back of the surface reflects.
        response_plan: factor W of a pair; None for 1.
        chirp, aperture: the radar, T samples and N pairs.
        gradient: dL / d Re h + j dL / d Im h, shape (N, T).

    Returns:
        By point, normal, area and taper of every sample of the plan, shape (S, 8).
    """
    response = None if response_plan is None else Response(response_plan)
    target = _TargetAdjoint(plan, SampleTables(plan), aperture, two_sided, response)
    to_bins = np.ascontiguousarray(plan.ranges.to_samples.conj().T)
    total = np.zeros((len(plan.cell_of_sample), SAMPLE_FLOATS))
    waiting: list[tuple[NDArray[np.int64], list[Float]]] = []
    for work in tiles:
        rows = work.tile.rows
        demodulated = gradient[rows] * reference_phase(chirp, aperture, rows, plan.ranges.center_m).conj()
        for frequency in range(1 if response_plan is None else len(response_plan.frequencies_hz)):
            spectrum = demodulated
            if response_plan is not None:
                spectrum = spectrum * response_plan.to_samples[frequency].conj()
            bins = spectrum.astype(np.complex64) @ to_bins  # stage 4
            launched = [target.lit(work, bins, frequency), target.partial(work, bins, frequency)]
            _add(total, waiting)
            waiting = [part for part in launched if part is not None]
    _add(total, waiting)
    return total


def _add(total: NDArray[np.float64], parts: list[tuple[NDArray[np.int64], list[Float]]]) -> None:
    for members, sums in parts:
        total[members] += np.stack([value.numpy() for value in sums], axis=1)


@dataclass(frozen=True, eq=False)
class _TargetAdjoint:
    """Stages 3 to 1 for the tiles of one target: (samples, their launched sums), None where there are none."""

    plan: Factorisation
    tables: SampleTables
    aperture: Aperture
    two_sided: bool
    response: Response | None

    def lit(
        self, work: TileWork, bins: NDArray[np.complex64], frequency: int
    ) -> tuple[NDArray[np.int64], list[Float]] | None:
        """Samples that the whole tile sees: by way of its nodes."""
        if len(work.members) == 0:
            return None
        tile = work.tile
        moments = self.collect(work, bins, work.cells)
        if tile.weights is not None:
            moments = tile.weights.T @ moments  # stage 2
        table = moments.transpose(2, 1, 0)  # (cells, nodes, 2 * NUM_MOMENTS)
        centers = self.plan.cells.centers_m[work.cells]
        paths = None
        if self.response is not None:
            table, paths = _through_paths(
                self.response, table, centers, tile.node_tx_m, tile.node_rx_m, frequency
            )
        lanes = AdjointLanes(
            member=to_device_index(work.members),
            cell=to_device_index(_place_of(self.plan, work.members, work.cells)),
            centers=to_device(centers),
            transmitters=to_device(tile.node_tx_m),
            receivers=None if tile.node_rx_m is None else to_device(tile.node_rx_m),
            num_antennas=len(tile.node_tx_m),
            moments=to_device(table),
            paths=paths,
            visible=None,
        )
        return work.members, self._launched(lanes, frequency)

    def partial(
        self, work: TileWork, bins: NDArray[np.complex64], frequency: int
    ) -> tuple[NDArray[np.int64], list[Float]] | None:
        """Samples that only some antennas of the tile see: antenna by antenna."""
        members, rows = work.visibility.partial, work.tile.rows
        if len(members) == 0:
            return None
        cells = np.unique(self.plan.cell_of_sample[members])
        aperture = self.aperture
        lanes = AdjointLanes(
            member=to_device_index(members),
            cell=to_device_index(_place_of(self.plan, members, cells)),
            centers=to_device(self.plan.cells.centers_m[cells]),
            transmitters=to_device(aperture.tx_m[rows]),
            receivers=None if aperture.rx_m is None else to_device(aperture.rx_m[rows]),
            num_antennas=len(rows),
            moments=to_device(self.collect(work, bins, cells).transpose(2, 1, 0)),
            paths=None,
            visible=to_device(work.tile.ray_weights @ work.visibility.partial_visible),
        )
        return members, self._launched(lanes, frequency)

    def collect(
        self, work: TileWork, bins: NDArray[np.complex64], cells: NDArray[np.int64]
    ) -> NDArray[np.float32]:
        """Stage 3: adjoint moments of cells at the antennas of a tile, (2 * NUM_MOMENTS, n, cells)."""
        rows, center, aperture = work.tile.rows, self.plan.ranges.center_m, self.aperture
        receivers = None if aperture.rx_m is None else aperture.rx_m[rows] - center
        antennas = Antennas(aperture.tx_m[rows] - center, receivers)
        return collect_cells(
            bins, self.plan.ranges, antennas, to_device_index(cells), self.tables.cell_centers
        )

    def _launched(self, lanes: AdjointLanes, frequency: int) -> list[Float]:
        return sample_adjoint(
            self.tables.in_cells, lanes, self.plan.ranges, self.two_sided, self.response, frequency
        )


def _through_paths(
    response: Response,
    moments: NDArray[np.float32],
    centers_m: NDArray[np.float64],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    frequency: int,
) -> tuple[NDArray[np.float32], Float | None]:
    """Adjoint moments before the path factor of every (cell, node), and how that grows within the cell."""
    cells, nodes = len(centers_m), len(tx_m)
    lane_cell, lane_node = np.repeat(np.arange(cells), nodes), np.tile(np.arange(nodes), cells)
    sides = [side for side in (tx_m, rx_m) if side is not None]
    path = response.path_of_cells(
        _vectors(centers_m, lane_cell), [_vectors(side, lane_node) for side in sides],
        dr.full(UInt32, frequency, cells * nodes),
    )  # fmt: skip
    if path is None:
        return moments, dr.zeros(Float, 8 * cells * nodes)
    value = (path.value.real.numpy() + 1j * path.value.imag.numpy()).reshape(cells, nodes, 1)
    packed = np.ascontiguousarray(moments).view(np.complex64) * value.conj().astype(np.complex64)
    slopes = [axis.numpy() for vector in (path.gradient_real, path.gradient_imaginary) for axis in vector]
    padding = 2 * [np.zeros(cells * nodes, dtype=np.float32)]
    return packed.view(np.float32), to_device(np.stack([*slopes, *padding], axis=1))


def _vectors(positions_m: NDArray[np.float64], index: NDArray[np.int64]) -> Any:
    return dr.gather(Array3f, to_device(positions_m), to_device_index(index))


def _place_of(plan: Factorisation, members: NDArray[np.int64], cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Place of every member's cell in a list of cells."""
    place = np.zeros(len(plan.cells), dtype=np.int64)
    place[cells] = np.arange(len(cells))
    return place[plan.cell_of_sample[members]]
