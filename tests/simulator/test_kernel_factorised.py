"""The fast kernel against its float64 twin (same plan) and against the dense sum (no plan at all)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from waveformer.simulator import fast_echo, primitives
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.factorisation import Factorisation, TileWork, taper_scale
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.numerics import DRAFT, FAST, Numerics
from waveformer.simulator.quadrature import SurfaceSamples, sample_surface
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference import dense_echo
from waveformer.simulator.reference_factorised import factorised_echo
from waveformer.simulator.response_plan import ResponsePlan
from waveformer.simulator.scene import VISIBLE, SampleTable, build_scene, sample_states

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 4e9, 32)
WAVELENGTH_M = SPEED_OF_LIGHT_M_PER_S / CHIRP.center_hz
GRID = Aperture.planar_grid(14, 12, 0.004)
SHADOWS = FAST.model_copy(update={"interpolate_shadows": True})
KINDS = ["monostatic", "equal offset", "irregular"]


def aperture_of(kind: str) -> Aperture:
    if kind == "monostatic":
        return GRID
    if kind == "equal offset":
        return Aperture(GRID.tx_m, GRID.tx_m + [0.015, -0.005, 0.0])
    jitter = np.random.default_rng(1).uniform(-0.02, 0.02, GRID.tx_m.shape)
    return Aperture(GRID.tx_m, GRID.tx_m + jitter)


def ball() -> Any:
    mesh = primitives.sphere(0.02, 0.003)
    mesh.apply_translation([0.005, 0.0, -0.3])
    return mesh


def bent_sheet() -> Any:
    """An open, two-sided sheet, part of which shadows the rest."""
    mesh = primitives.plate(0.06, 0.04, 0.002)
    mesh.vertices[:, 2] = 0.012 * np.sin(120 * mesh.vertices[:, 0]) - 0.3
    mesh.apply_transform([[0.8, 0, 0.6, 0.18], [0, 1, 0, 0], [-0.6, 0, 0.8, -0.06], [0, 0, 0, 1]])
    return mesh


@dataclass
class Run:
    """What the kernel was given, and what it made of it."""

    h: np.ndarray
    plan: Factorisation
    work: list[TileWork]
    samples: SurfaceSamples
    scene: Any
    two_sided: bool


def run(
    mesh: Any, aperture: Aperture, monkeypatch: pytest.MonkeyPatch, numerics: Numerics = FAST,
    tile_positions: int | None = None, response: ResponsePlan | None = None,
) -> Run:  # fmt: skip
    surface = load_mesh(mesh)
    samples = sample_surface(surface, np.eye(4), WAVELENGTH_M / 3)
    scene = build_scene([(surface.vertices_m, surface.faces)])
    plans: list[Factorisation] = []
    work: list[TileWork] = []
    original = fast_echo._batches

    def recorded(plan: Factorisation, *rest: Any) -> Iterator[list[TileWork]]:
        plans.append(plan)
        for batch in original(plan, *rest):
            work.extend(batch)
            yield batch

    monkeypatch.setattr(fast_echo, "_batches", recorded)
    h = np.zeros((len(aperture), CHIRP.num_samples), dtype=complex)

    def add(rows: np.ndarray, echo: np.ndarray) -> None:
        h[rows] += echo

    closest_m = -float(surface.vertices_m[:, 2].max())
    fast_echo.fast_echo(
        scene,
        EchoSource(samples, surface.two_sided, closest_m, response),
        CHIRP,
        aperture,
        numerics,
        tile_positions,
        add,
    )
    monkeypatch.setattr(fast_echo, "_batches", original)
    return Run(h, plans[0], work, samples, scene, surface.two_sided)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


def difference_from_dense(result: Run, whole: Aperture) -> float:
    """Compared at every 15th row, the corners of the grid and its inside among them."""
    rows = np.append(np.arange(0, len(whole), 15), len(whole) - 1)
    aperture = Aperture(whole.tx_m[rows], None if whole.rx_m is None else whole.rx_m[rows])
    samples = result.samples
    states = sample_states(
        result.scene,
        SampleTable(samples.points_m, samples.normals),
        result.two_sided,
        aperture.tx_m,
        aperture.rx_m,
    )
    taper = taper_scale(samples, WAVELENGTH_M, True)
    expected = dense_echo(samples, taper, CHIRP, aperture, states == VISIBLE, result.two_sided)
    return difference(result.h[rows], expected)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("make", "numerics"),
    [(ball, FAST), (bent_sheet, FAST), (bent_sheet, DRAFT)],
    ids=["ball", "sheet", "draft"],
)
def test_the_kernel_equals_its_float64_twin(
    make: Any, numerics: Numerics, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    aperture = aperture_of(kind)
    result = run(make(), aperture, monkeypatch, numerics)
    twin = factorised_echo(result.plan, result.work, CHIRP, aperture, result.two_sided)
    # float32 and the phasor's 1.3e-6, on terms up to some ten times larger than their sum
    assert difference(result.h, twin) < 3e-5


@pytest.mark.parametrize("kind", KINDS)
def test_on_a_convex_object_the_kernel_equals_the_dense_sum(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    aperture = aperture_of(kind)
    result = run(ball(), aperture, monkeypatch)
    assert not result.two_sided
    # The tolerance bounds the phase only. Where the lit cap ends the integrand has a kink, and for a pair a
    # step (one antenna sets before the other), over which nodes interpolate with an error of their own.
    assert difference_from_dense(result, aperture) < (10 if kind == "equal offset" else 4) * FAST.tolerance


@pytest.mark.parametrize("kind", KINDS)
def test_on_an_open_sheet_with_shadows_the_kernel_equals_the_dense_sum(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    aperture = aperture_of(kind)
    result = run(bent_sheet(), aperture, monkeypatch)
    assert result.two_sided
    assert any(len(item.visibility.partial) for item in result.work)
    # visibility is interpolated between rays about 2 degrees apart, and shadow edges echo
    assert difference_from_dense(result, aperture) < 0.015


@pytest.mark.parametrize("kind", ["monostatic", "equal offset"])
def test_the_edges_of_shadows_can_be_interpolated(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    aperture = aperture_of(kind)
    pairs = run(bent_sheet(), aperture, monkeypatch)
    nodes = run(bent_sheet(), aperture, monkeypatch, SHADOWS)
    assert any(item.node_share is not None for item in nodes.work)
    assert not any(len(item.visibility.partial) for item in nodes.work)
    # an edge that enters or leaves a cell inside a tile bends its moments; most of the echo is no edge
    assert 1e-5 < difference(nodes.h, pairs.h) < 0.02


def test_antennas_that_share_no_nodes_sum_shadows_pair_by_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    aperture = aperture_of("irregular")
    pairs, nodes = (run(bent_sheet(), aperture, monkeypatch, numerics) for numerics in (FAST, SHADOWS))
    assert difference(nodes.h, pairs.h) < 1e-5
    assert any(len(item.visibility.partial) for item in nodes.work)


def test_a_finer_tolerance_comes_closer_to_the_dense_sum(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = []
    for tolerance in (3e-2, 1e-3):
        result = run(ball(), GRID, monkeypatch, FAST.model_copy(update={"tolerance": tolerance}))
        errors.append(difference_from_dense(result, GRID))
    assert errors[1] < errors[0]


@pytest.mark.parametrize("tile_positions", [1, 7, 50])
@pytest.mark.parametrize("numerics", [FAST, SHADOWS], ids=["pairs", "nodes"])
@pytest.mark.parametrize("kind", ["monostatic", "irregular"])
def test_splitting_tiles_changes_rounding_only(
    kind: str, numerics: Numerics, tile_positions: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    aperture = aperture_of(kind)
    whole = run(bent_sheet(), aperture, monkeypatch, numerics)
    split = run(bent_sheet(), aperture, monkeypatch, numerics, tile_positions=tile_positions)
    assert difference(split.h, whole.h) < 1e-5  # float32 sums in another order


def test_narrow_batches_change_rounding_only(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = run(ball(), GRID, monkeypatch)
    monkeypatch.setattr(fast_echo, "_MAX_LANES", 1)
    one_by_one = run(ball(), GRID, monkeypatch)
    assert len(one_by_one.work) == len(whole.work)
    assert difference(one_by_one.h, whole.h) < 1e-5  # float32 sums in another order


def test_without_the_facet_taper_the_plan_holds_none(monkeypatch: pytest.MonkeyPatch) -> None:
    result = run(ball(), GRID, monkeypatch, FAST.model_copy(update={"facet_taper": False}))
    assert not result.plan.taper.any()
    tapered = run(ball(), GRID, monkeypatch)
    assert (tapered.plan.taper > 0).all()
    assert difference(result.h, tapered.h) > 1e-4
