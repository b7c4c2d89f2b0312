"""Forward model: pairs per second of the kernel, of a whole simulation, and of NumPy programs beside it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy_forward import direct, factorised, plain, seen_samples
from scenes import APERTURE, CHIRP, Surface, bumpy_ellipsoid, measure, relative_l2, report

from waveformer.simulator import fast_echo
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.factorisation import Factorisation, TileWork
from waveformer.simulator.forward import simulate
from waveformer.simulator.numerics import FAST
from waveformer.simulator.quadrature import take
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.reference import dense_echo
from waveformer.simulator.reference_factorised import factorised_echo
from waveformer.simulator.target import Target

# The exact sum is taken at every STRIDE-th sample of the chirp only.
STRIDE = 16
SPARSE_CHIRP = Chirp(CHIRP.start_hz, CHIRP.bandwidth_hz, CHIRP.num_samples // STRIDE)


def plan_work(surface: Surface) -> tuple[Factorisation, list[list[TileWork]]]:
    """Everything `fast_echo` does before it sums, taken out of a run of it: visibility, cells, tiles."""
    planned = fast_echo.plan_echo(
        surface.scene, EchoSource(surface.samples, False, surface.closest_m), CHIRP, APERTURE, FAST
    )
    assert planned is not None
    return planned[0], list(planned[1])


def run_kernel(plan: Factorisation, batches: list[list[TileWork]]) -> Any:
    """Stages 1 to 4 of `fast_echo`, the transfer of the samples included; shape (N, T)."""
    h = np.zeros((len(APERTURE), CHIRP.num_samples), dtype=np.complex64)

    def add(rows: Any, echo: Any) -> None:
        h[rows] += echo

    source = EchoSource(plan.samples, False, 0.0)
    fast_echo.sum_batches(plan, batches, source, CHIRP, APERTURE, None, add)
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


def exact_rows(plan: Factorisation, item: TileWork, places: Any) -> Any:
    """Every pair and every exponential in float64, the visibility that of the kernel: (rows, T / STRIDE)."""
    members, seen = seen_samples(item, places)
    samples = take(plan.samples, members)
    echo = []
    for tx_m, visible in zip(APERTURE.tx_m[item.tile.rows[places]], seen, strict=True):
        weighted = replace(samples, areas_m2=samples.areas_m2 * visible)
        one = Aperture(tx_m[None])
        everything = np.ones((1, len(members)), dtype=bool)
        echo.append(dense_echo(weighted, plan.taper[members], SPARSE_CHIRP, one, everything, False)[0])
    return np.stack(echo)


def main(quick: bool) -> None:
    surface = Surface(bumpy_ellipsoid(), FAST)
    plan, batches = plan_work(surface)
    work = [item for batch in batches for item in batch]
    pairs = sum(lit_pairs(plan, item) for item in work)
    kernel = measure(lambda: run_kernel(plan, batches), 5 if quick else 9).rate(pairs)
    whole = measure(lambda: simulate(Target(surface.mesh), CHIRP, APERTURE), 5).rate(pairs)

    # NumPy needs far longer: some tiles stand for all, and some of their antennas where pairs are visited
    some = work[:: len(work) // (2 if quick else 4)]
    few = [np.arange(0, len(item.tile.rows), 6) for item in some]
    some_pairs = [lit_pairs(plan, item) for item in some]
    few_pairs = sum(lit_pairs(plan, item, places) for item, places in zip(some, few, strict=True))
    # the error is taken at the second of the few antennas of each of these tiles
    truth = np.concatenate(
        [exact_rows(plan, item, places[1:2]) for item, places in zip(some, few, strict=True)]
    )
    rows = [item.tile.rows[places[1]] for item, places in zip(some, few, strict=True)]

    def error(echo: Any) -> float:
        return relative_l2(np.asarray(echo)[:, ::STRIDE], truth)

    def numpy_rate(name: str, program: Callable[[], Any], count: int, echo: Any) -> dict[str, Any]:
        rate = measure(program, 3 if quick else 5).rate(count)
        slower = kernel["pairs_per_cpu_s"] / rate["pairs_per_cpu_s"]
        return {"name": name, **rate, "slower_than_kernel": slower, "relative_l2_error": error(echo)}

    def by_tile() -> list[Any]:
        return [factorised(plan, item, CHIRP, APERTURE) for item in some]

    def by_antenna(program: Callable[..., Any]) -> list[Any]:
        return [program(plan, item, places, CHIRP, APERTURE) for item, places in zip(some, few, strict=True)]

    report(
        [
            {"name": "forward kernel", **kernel, "relative_l2_error": error(run_kernel(plan, batches)[rows])},
            {"name": "forward, mesh to raw signal", **whole},
            numpy_rate(
                "NumPy float64, the same factorisation",
                lambda: factorised_echo(plan, some[:1], CHIRP, APERTURE, False),
                some_pairs[0],
                factorised_echo(plan, some, CHIRP, APERTURE, False)[rows],
            ),
            numpy_rate(
                "NumPy float32, the same factorisation",
                by_tile,
                sum(some_pairs),
                [echo[places[1]] for echo, places in zip(by_tile(), few, strict=True)],
            ),
            *(
                numpy_rate(
                    f"NumPy {precision}, every pair, 0.5 mm bins",
                    lambda program=program: by_antenna(program),
                    few_pairs,
                    [echo[1] for echo in by_antenna(program)],
                )
                for precision, program in (("float64", plain), ("float32", direct))
            ),
        ]
    )


if __name__ == "__main__":
    main("--quick" in sys.argv)
