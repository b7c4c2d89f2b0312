"""Forward model: pairs per second of the kernel, of a whole simulation, and of NumPy programs beside it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy_forward import direct, factorised, plain
from scenes import APERTURE, CHIRP, Surface, bumpy_ellipsoid, measure, relative_l2, report

from waveformer.simulator import fast_echo
from waveformer.simulator.factorisation import Factorisation, TileWork
from waveformer.simulator.forward import simulate
from waveformer.simulator.numerics import FAST
from waveformer.simulator.range_bins import reference_phase
from waveformer.simulator.reference_factorised import factorised_echo
from waveformer.simulator.target import Target


def plan_work(surface: Surface) -> tuple[Factorisation, list[list[TileWork]]]:
    """Everything `fast_echo` does before it sums, taken out of a run of it: visibility, cells, tiles."""
    recorded: list[Any] = []
    form_batches = fast_echo._batches

    def record(plan: Factorisation, *rest: Any) -> list[list[TileWork]]:
        batches = list(form_batches(plan, *rest))
        recorded.append((plan, batches))
        return batches

    fast_echo._batches = record  # type: ignore[assignment]
    try:
        fast_echo.fast_echo(
            surface.scene,
            surface.samples,
            False,
            surface.closest_m,
            CHIRP,
            APERTURE,
            FAST,
            None,
            lambda rows, echo: None,
        )
    finally:
        fast_echo._batches = form_batches
    return recorded[0]


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


def lit_pairs(plan: Factorisation, work: TileWork, rows: Any = slice(None)) -> int:
    """Pairs of antenna and sample that see each other: the sample faces the antenna and is lit."""
    antennas = APERTURE.tx_m[work.tile.rows[rows]]
    partly = work.tile.ray_weights[rows] @ work.visibility.partial_visible > 0
    pairs = 0
    for members, seen in ((work.members, True), (work.visibility.partial, partly)):
        normals = plan.samples.normals[members]
        heights = (plan.samples.points_m[members] * normals).sum(axis=1)
        pairs += int(np.count_nonzero((antennas @ normals.T > heights) & seen))
    return pairs


def main(quick: bool) -> None:
    surface = Surface(bumpy_ellipsoid(), FAST)
    plan, batches = plan_work(surface)
    work = [item for batch in batches for item in batch]
    pairs = sum(lit_pairs(plan, item) for item in work)
    runs = 5 if quick else 9
    kernel = measure(lambda: run_kernel(plan, batches), runs).rate(pairs)
    whole = measure(lambda: simulate(Target(surface.mesh), CHIRP, APERTURE), 5).rate(pairs)

    # NumPy needs far longer: some tiles, and for `direct` and `plain` some of their antennas, stand for all
    some = work[:: len(work) // (2 if quick else 4)]
    rows = np.concatenate([item.tile.rows for item in some])
    fast = run_kernel(plan, batches)
    truth = factorised_echo(plan, some, CHIRP, APERTURE, False)[rows]
    single = np.concatenate([factorised(plan, item, CHIRP, APERTURE) for item in some])
    few = [np.arange(0, len(item.tile.rows), 6) for item in some]
    few_truth = fast[np.concatenate([item.tile.rows[r] for item, r in zip(some, few, strict=True)])]
    few_pairs = sum(lit_pairs(plan, item, r) for item, r in zip(some, few, strict=True))

    def by_antenna(program: Callable[..., Any]) -> Any:
        echoes = [program(plan, item, r, CHIRP, APERTURE) for item, r in zip(some, few, strict=True)]
        return np.concatenate(echoes)

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
                lit_pairs(plan, some[0]),
                0.0,
            ),
            numpy_rate(
                "NumPy float32, the same factorisation",
                lambda: [factorised(plan, item, CHIRP, APERTURE) for item in some],
                sum(lit_pairs(plan, item) for item in some),
                relative_l2(single, truth),
            ),
            numpy_rate(
                "NumPy float64, every pair, 0.5 mm bins",
                lambda: by_antenna(plain),
                few_pairs,
                relative_l2(by_antenna(plain), few_truth),
            ),
            numpy_rate(
                "NumPy float32, every pair, 0.5 mm bins",
                lambda: by_antenna(direct),
                few_pairs,
                relative_l2(by_antenna(direct), few_truth),
            ),
        ]
    )


if __name__ == "__main__":
    main("--quick" in sys.argv)
