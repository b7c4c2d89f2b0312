"""Forward model: pairs per second of the kernel and of a whole simulation, and of NumPy programs beside it."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy_forward import direct, factorised
from scenes import APERTURE, CHIRP, Surface, bumpy_ellipsoid, measure, relative_l2, report

from waveformer.simulator import fast_echo
from waveformer.simulator.factorisation import Factorisation, TileWork, factorise
from waveformer.simulator.forward import simulate
from waveformer.simulator.numerics import FAST
from waveformer.simulator.quadrature import take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.range_bins import reference_phase
from waveformer.simulator.reference_factorised import factorised_echo
from waveformer.simulator.subapertures import build_tiles
from waveformer.simulator.target import Target
from waveformer.simulator.visibility import VisibilityMap


def plan_work(surface: Surface) -> tuple[Factorisation, list[list[TileWork]]]:
    """Everything `fast_echo` does before it sums: visibility, cells, tiles."""
    samples, closest_m = surface.samples, surface.closest_m
    visibility = VisibilityMap(
        surface.scene, samples, False, APERTURE, closest_m * np.radians(FAST.probe_spacing_deg)
    )
    seen = np.flatnonzero(visibility.seen)
    plan, order = factorise(take(samples, seen), CHIRP, facet_taper=FAST.facet_taper)
    tiles = build_tiles(
        APERTURE,
        closest_m,
        plan.cells.radius_m,
        SPEED_OF_LIGHT_M_PER_S / float(CHIRP.frequencies_hz[-1]),
        FAST.tolerance,
        closest_m * np.radians(FAST.leaf_spacing_deg),
    )
    return plan, list(fast_echo._batches(plan, tiles, visibility.select(seen[order])))


def run_kernel(plan: Factorisation, batches: list[list[TileWork]]) -> Any:
    """Stages 1 to 4 of `fast_echo`, the transfer of the samples included; shape (N, T)."""
    h = np.zeros((len(APERTURE), CHIRP.num_samples), dtype=np.complex64)
    tables = fast_echo._SampleTables(plan)
    for batch in batches:
        moments = fast_echo._moments_at_nodes(plan, tables, batch, False)
        for work, at_nodes in zip(batch, moments, strict=True):
            bins = fast_echo._tile_bins(plan, tables, work, at_nodes, APERTURE, False)
            rows = work.tile.rows
            h[rows] += (bins @ plan.ranges.to_samples) * reference_phase(
                CHIRP, APERTURE, rows, plan.ranges.center_m
            )
    return h


def lit_pairs(work: TileWork) -> int:
    """Pairs of sample and antenna that see each other, wholly or in part."""
    partly = work.tile.ray_weights @ work.visibility.partial_visible
    return len(work.tile.rows) * len(work.members) + int(np.count_nonzero(partly > 0))


def main(quick: bool) -> None:
    surface = Surface(bumpy_ellipsoid(), FAST)
    plan, batches = plan_work(surface)
    work = [item for batch in batches for item in batch]
    pairs = sum(map(lit_pairs, work))
    runs = 5 if quick else 9
    kernel = measure(lambda: run_kernel(plan, batches), runs).rate(pairs)
    whole = measure(lambda: simulate(Target(surface.mesh), CHIRP, APERTURE), 5).rate(pairs)

    # NumPy needs far longer: some tiles, or some antennas of every tile, stand for all
    some = work[:: len(work) // (2 if quick else 4)]
    rows = np.concatenate([item.tile.rows for item in some])
    fast = run_kernel(plan, batches)
    truth = factorised_echo(plan, some, CHIRP, APERTURE, False)[rows]
    single = np.concatenate([factorised(plan, item, CHIRP, APERTURE) for item in some])
    few = [np.arange(0, len(item.tile.rows), 40 if quick else 15) for item in work]
    every = [direct(plan, item, r, CHIRP, APERTURE) for item, r in zip(work, few, strict=True)]
    few_rows = np.concatenate([item.tile.rows[r] for item, r in zip(work, few, strict=True)])
    some_pairs, few_pairs = sum(map(lit_pairs, some)), sum(count for _, count in every)

    def numpy_rate(name: str, work_on: Any, count: int, error: float) -> dict[str, Any]:
        rate = measure(work_on, 3 if quick else 5).rate(count)
        return {
            "name": name,
            **rate,
            "slower_than_kernel": kernel["pairs_per_cpu_s"] / rate["pairs_per_cpu_s"],
            "relative_l2_error": error,
        }

    report(
        [
            {"name": "forward kernel", **kernel, "relative_l2_error": relative_l2(fast[rows], truth)},
            {"name": "forward, mesh to raw signal", **whole},
            numpy_rate(
                "NumPy float64, the same factorisation",
                lambda: factorised_echo(plan, some[:1], CHIRP, APERTURE, False),
                lit_pairs(some[0]),
                0.0,
            ),
            numpy_rate(
                "NumPy float32, the same factorisation",
                lambda: [factorised(plan, item, CHIRP, APERTURE) for item in some],
                some_pairs,
                relative_l2(single, truth),
            ),
            numpy_rate(
                "NumPy float32, every pair, 0.5 mm bins",
                lambda: [direct(plan, item, r, CHIRP, APERTURE) for item, r in zip(work, few, strict=True)],
                few_pairs,
                relative_l2(np.concatenate([echo for echo, _ in every]), fast[few_rows]),
            ),
        ]
    )


if __name__ == "__main__":
    main("--quick" in sys.argv)
