"""The exact mode against the dense float64 sum with the same visibility."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator import exact_echo, primitives
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.numerics import EXACT
from waveformer.simulator.quadrature import SurfaceSamples, sample_surface
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference import dense_echo
from waveformer.simulator.scene import VISIBLE, SampleTable, build_scene, sample_states

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 4e9, 32)
WAVELENGTH_M = SPEED_OF_LIGHT_M_PER_S / CHIRP.center_hz
GRID = Aperture.planar_grid(4, 3, 0.02)
PAIRS = Aperture(GRID.tx_m, GRID.tx_m + np.random.default_rng(2).uniform(-0.02, 0.02, GRID.tx_m.shape))


def open_box() -> Any:
    """Two plates at an angle, one shadowing part of the other; open, so both sides reflect."""
    upper = primitives.plate(0.02, 0.03, 0.005, center_m=(0.0, 0.0, -0.27))
    lower = primitives.plate(0.06, 0.05, 0.005)
    lower.apply_transform([[0.96, 0, 0.28, 0], [0, 1, 0, 0], [-0.28, 0, 0.96, -0.3], [0, 0, 0, 1]])
    return upper + lower


def ball() -> Any:
    mesh = primitives.sphere(0.02, 0.004)
    mesh.apply_translation([0.005, 0.0, -0.3])
    return mesh


def prepared(mesh: Any) -> tuple[SurfaceMesh, SurfaceSamples, Any]:
    surface = load_mesh(mesh)
    scene = build_scene([(surface.vertices_m, surface.faces)])
    return surface, sample_surface(surface, np.eye(4), WAVELENGTH_M / 3), scene


def echo_of(mesh: Any, aperture: Aperture, tile_positions: int | None = None) -> np.ndarray:
    surface, samples, scene = prepared(mesh)
    h = np.zeros((len(aperture), CHIRP.num_samples), dtype=complex)

    def add(rows: np.ndarray, echo: np.ndarray) -> None:
        assert tile_positions is None or len(rows) <= tile_positions
        h[rows] += echo

    source = EchoSource(samples, surface.two_sided, 0.3)
    exact_echo.exact_echo(scene, source, CHIRP, aperture, EXACT, tile_positions, add)
    return h


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


@pytest.mark.parametrize("aperture", [GRID, PAIRS], ids=["monostatic", "bistatic"])
@pytest.mark.parametrize("make", [ball, open_box])
def test_the_exact_mode_equals_the_dense_sum(make: Any, aperture: Aperture) -> None:
    surface, samples, scene = prepared(make())
    states = sample_states(
        scene, SampleTable(samples.points_m, samples.normals), surface.two_sided, aperture.tx_m, aperture.rx_m
    )
    taper = taper_scale(samples, WAVELENGTH_M, True)
    expected = dense_echo(samples, taper, CHIRP, aperture, states == VISIBLE, surface.two_sided)
    # float32 and the frequency interpolation's 1e-5, on terms up to ten times larger than their sum
    assert difference(echo_of(make(), aperture), expected) < 1e-4


def test_both_sides_of_an_open_mesh_are_summed_and_a_shadow_is_not() -> None:
    surface, samples, scene = prepared(open_box())
    assert surface.two_sided
    states = sample_states(scene, SampleTable(samples.points_m, samples.normals), True, GRID.tx_m, None)
    assert 0.05 < (states != VISIBLE).mean() < 0.5
    flipped = open_box()
    flipped.invert()
    assert difference(echo_of(flipped, GRID), echo_of(open_box(), GRID)) < 1e-4  # another order of bisection


@pytest.mark.parametrize("tile_positions", [1, 5])
def test_groups_of_positions_change_rounding_only(tile_positions: int) -> None:
    assert difference(echo_of(ball(), GRID, tile_positions), echo_of(ball(), GRID)) < 1e-5  # float32


def test_a_small_budget_of_pairs_changes_rounding_only(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = echo_of(ball(), GRID)
    monkeypatch.setattr(exact_echo, "_MAX_PAIRS", 1)
    assert difference(echo_of(ball(), GRID), whole) < 1e-5  # float32
