"""NumPy float64 twin of the factorised kernel: the same plan, the same stages, plain array code.

It shows that the algorithm is right apart from float32 and Dr.Jit, and it is the program that the speed
of `fast_echo` is quoted against.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.factorisation import Factorisation, TileWork
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, RangeBins, reference_phase
from waveformer.simulator.reference import integrand
from waveformer.simulator.reference_response import pair_response
from waveformer.simulator.response_plan import ResponsePlan


def factorised_echo(
    plan: Factorisation,
    work: list[TileWork],
    chirp: Chirp,
    aperture: Aperture,
    two_sided: bool,
    response: ResponsePlan | None = None,
) -> NDArray[np.complex128]:
    """Echo of one target, shape (N, T), not yet multiplied by j / (4 pi).

    Args:
        plan: cells and bins of the target.
        work: its tiles and what they see.
        chirp, aperture: the radar.
        two_sided: whether the back of the surface reflects.
        response: what W consists of; None for W = 1.
    """
    echo = np.zeros((len(aperture), chirp.num_samples), dtype=np.complex128)
    for item in work:
        bins = np.zeros((len(item.tile.rows), plan.ranges.count, NUM_MOMENTS), dtype=np.complex128)
        moments = _moments_at_nodes(plan, item, two_sided, response)  # stage 1: (nodes, cells, moments)
        if item.tile.weights is not None:
            moments = np.tensordot(item.tile.weights.astype(np.float64), moments, axes=1)  # stage 2
        _deposit(bins, plan.ranges, moments, _excess(aperture, item, plan, plan.cells.centers_m[item.cells]))
        _deposit_partial(bins, plan, item, aperture, two_sided, response)
        spectrum = bins.reshape(len(bins), -1) @ plan.ranges.to_samples  # stage 4
        spectrum = spectrum * reference_phase(chirp, aperture, item.tile.rows, plan.ranges.center_m)
        if response is not None:
            spectrum = spectrum * response.to_samples[item.frequency]
        echo[item.tile.rows] += spectrum
    return echo


def _moments_at_nodes(
    plan: Factorisation, item: TileWork, two_sided: bool, response: ResponsePlan | None
) -> NDArray[np.complex128]:
    """Stage 1: moments of the lit samples of every cell at every node of the tile."""
    tile, ranges = item.tile, plan.ranges
    columns = np.concatenate(
        [np.arange(first, last) for first, last in zip(item.first, item.last, strict=True)]
        or [np.empty(0, dtype=np.int64)]
    )
    members = item.members[columns]
    counts = item.last - item.first
    starts = np.cumsum(counts) - counts
    centers = np.repeat(plan.cells.centers_m[item.cells], counts, axis=0)
    samples = plan.samples
    receivers = tile.node_tx_m if tile.node_rx_m is None else tile.node_rx_m
    moments = np.empty((len(tile.node_tx_m), len(item.cells), NUM_MOMENTS), dtype=np.complex128)
    for node, (tx_m, rx_m) in enumerate(zip(tile.node_tx_m, receivers, strict=True)):
        amplitude, range_m = integrand(
            samples.points_m[members], samples.normals[members], samples.areas_m2[members],
            plan.taper[members], tx_m, rx_m, two_sided,
        )  # fmt: skip
        to_center = 0.5 * (np.linalg.norm(tx_m - centers, axis=1) + np.linalg.norm(rx_m - centers, axis=1))
        if item.node_share is not None:
            amplitude = amplitude * item.node_share[node, columns]
        excess = range_m - to_center
        value = amplitude * np.exp(-4j * np.pi / ranges.wavelength_m * excess)
        value = value * _response(
            response, item, samples.points_m[members], samples.normals[members], tx_m, rx_m
        )
        for moment in range(NUM_MOMENTS):
            if len(members):
                moments[node, :, moment] = np.add.reduceat(value, starts)
            value = value * (excess / ranges.moment_scale_m)
    return moments


def _deposit(
    bins: NDArray[np.complex128],
    ranges: RangeBins,
    moments: NDArray[np.complex128],
    excess_m: NDArray[np.float64],
    count: int = NUM_MOMENTS,
) -> None:
    """Stage 3: carrier to the antenna, `count` moments about the bin's centre, sum into the bin."""
    nearest = np.round(excess_m / ranges.width_m)
    offset = (excess_m - nearest * ranges.width_m) / ranges.moment_scale_m
    rotated = moments * np.exp(-4j * np.pi / ranges.wavelength_m * excess_m)[..., None]
    m0, m1, m2, m3 = np.moveaxis(rotated, -1, 0)
    shifted = (
        m0,
        m1 + offset * m0,
        m2 + 2.0 * offset * m1 + offset**2 * m0,
        m3 + 3.0 * offset * m2 + 3.0 * offset**2 * m1 + offset**3 * m0,
    )
    index = (nearest.astype(np.int64) + ranges.count // 2) + np.arange(len(bins))[:, None] * ranges.count
    for moment, value in enumerate(shifted[:count]):
        for part, target in ((value.real, bins.real), (value.imag, bins.imag)):
            sums = np.bincount(index.ravel(), weights=part.ravel(), minlength=len(bins) * ranges.count)
            target[..., moment] += sums.reshape(len(bins), ranges.count)


def _deposit_partial(
    bins: NDArray[np.complex128],
    plan: Factorisation,
    item: TileWork,
    aperture: Aperture,
    two_sided: bool,
    response: ResponsePlan | None,
) -> None:
    """Samples whose visibility changes inside the tile, pair by pair."""
    partial, samples = item.visibility.partial, plan.samples
    if len(partial) == 0:
        return
    rows = item.tile.rows
    amplitude, _ = integrand(
        samples.points_m[partial], samples.normals[partial], samples.areas_m2[partial], plan.taper[partial],
        aperture.tx_m[rows][:, None], aperture.receivers_m[rows][:, None], two_sided,
    )  # fmt: skip
    amplitude = amplitude * (item.tile.ray_weights.astype(np.float64) @ item.visibility.partial_visible)
    moments = np.zeros((*amplitude.shape, NUM_MOMENTS), dtype=np.complex128)
    tx_m, rx_m = aperture.tx_m[rows][:, None], aperture.receivers_m[rows][:, None]
    weight = _response(response, item, samples.points_m[partial], samples.normals[partial], tx_m, rx_m)
    moments[..., 0] = amplitude * weight
    _deposit(
        bins,
        plan.ranges,
        moments,
        _excess(aperture, item, plan, samples.points_m[partial]),
        count=plan.lone_moments,
    )


def _excess(
    aperture: Aperture, item: TileWork, plan: Factorisation, points_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Mean range to points minus mean range to the reference point, shape (n, points)."""
    rows, total = item.tile.rows, np.zeros((len(item.tile.rows), len(points_m)))
    for antennas in (aperture.tx_m[rows], aperture.receivers_m[rows]):
        total += np.linalg.norm(antennas[:, None] - points_m, axis=2)
        total -= np.linalg.norm(antennas - plan.ranges.center_m, axis=1)[:, None]
    return 0.5 * total


def _response(
    response: ResponsePlan | None,
    item: TileWork,
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """W of samples and antennas that broadcast, at the frequency of the item."""
    if response is None:
        return np.ones(1, dtype=np.complex128)
    frequency_hz = float(response.frequencies_hz[item.frequency])
    return pair_response(response, frequency_hz, points_m, normals, tx_m, rx_m)
