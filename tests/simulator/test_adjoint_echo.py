"""The adjoint against forward mode, <J u, w> = <u, J^T w>, for everything that a sample is described by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.materials import Material
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.numerics import DIFFERENTIABLE
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.quadrature import sample_surface, take
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.response_plan import plan_response
from waveformer.simulator.surroundings import Surroundings

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 3.6e9, 8)
GRID = Aperture.planar_grid(6, 6, 0.006)
APERTURES: dict[str, Aperture] = {
    "monostatic": GRID,
    "pairs": Aperture(GRID.tx_m, GRID.tx_m + [0.02, -0.01, 0.0]),
    "irregular": Aperture(
        GRID.tx_m[::7], GRID.tx_m[::7] + np.sin(np.arange(18)).reshape(6, 3) * [0.01, 0.01, 0]
    ),
}
AROUND = {
    "open": (Material.pec(), Surroundings()),
    "matter": (Material.dielectric(3 - 0.2j, 0.003, 2e-4), Surroundings()),
    "sheet": (Material.pec(1e-4), Surroundings(sheets=(Sheet((0, 0, -0.1), (0.1, 0, 1), 0.003, 2 - 0.1j),))),
    "pattern": (Material.pec(), Surroundings(antenna=Antenna.from_preset("iwr1443"))),
    "gain": (Material.dielectric(3 - 0.2j), Surroundings(Antenna.isotropic(10.0))),
}


def term_of(aperture: Aperture, around: str) -> Any:
    """The echo of a wavy plate under a ball."""
    from waveformer.simulator.echo_source import EchoSource
    from waveformer.simulator.frozen import freeze_source
    from waveformer.simulator.scene import build_scene

    ball, plate = primitives.sphere(0.004, 0.0015), primitives.plate(0.018, 0.015, 0.003)
    ball.apply_translation([0.0, 0.0, -0.25])
    plate.apply_translation([0.0, 0.0, -0.26])
    meshes = [load_mesh(ball), load_mesh(plate)]
    scene = build_scene([(mesh.vertices_m, mesh.faces) for mesh in meshes])
    samples, (material, surroundings) = sample_surface(meshes[1], np.eye(4), 0.0013), AROUND[around]
    source = EchoSource(samples, True, 0.24)
    surface, index = freeze_source(scene, source, CHIRP, aperture, surroundings, "none", DIFFERENTIABLE)  # type: ignore[misc]
    plan = None
    if around != "open":
        bounds = np.array([samples.points_m.min(axis=0), samples.points_m.max(axis=0)])
        plan = plan_response(material, surroundings, "none", CHIRP, 1e-4, bounds, aperture.tx_m)
    assert any(len(work.visibility.partial) for work in surface.tiles)
    return surface.echo(take(samples, index), CHIRP, aperture, plan, 1j / (4.0 * np.pi))


@pytest.mark.parametrize(
    ("kind", "around"),
    [("monostatic", "open"), ("pairs", "open"), ("irregular", "open"), ("pairs", "matter"), ("pairs", "sheet"),
     ("monostatic", "pattern"), ("monostatic", "gain")],
)  # fmt: skip
def test_the_adjoint_is_the_transposed_of_forward_mode(
    rng: np.random.Generator, kind: str, around: str
) -> None:
    from waveformer.simulator.tangent_echo import Direction

    term = term_of(APERTURES[kind], around)
    h = term.value()
    weight = (rng.normal(size=h.shape) + 1j * rng.normal(size=h.shape)).astype(np.complex64)
    gradient = term.sample_gradient(weight)
    assert gradient.shape == (len(term.plan.samples.points_m), 8)
    # changes of about one part in a hundred of the echo
    for columns, size in ((slice(0, 3), 1e-5), (slice(3, 6), 1e-2), (slice(6, 7), 1e-8), (slice(7, 8), 1e-2)):
        direction = np.zeros(gradient.shape)
        # along the gradient, so that the inner product stands out of its terms
        direction[:, columns] = gradient[:, columns] * size / np.abs(gradient[:, columns]).max()
        moved = term.derivative(Direction(samples=direction))
        forwards, backwards = np.vdot(weight, moved).real, (gradient * direction).sum()
        # float32; forward mode interpolates derivatives between nodes, the adjoint gathers at the nodes
        assert forwards == pytest.approx(backwards, rel=1e-4), (columns, forwards, backwards)


def test_the_gradient_is_linear_in_that_of_the_signal(rng: np.random.Generator) -> None:
    term = term_of(GRID, "open")
    weights = [
        (rng.normal(size=(36, 8)) + 1j * rng.normal(size=(36, 8))).astype(np.complex64) for _ in range(2)
    ]
    one, other = (term.sample_gradient(weight) for weight in weights)
    both = term.sample_gradient((weights[0] - 2 * weights[1]).astype(np.complex64))
    assert np.abs(both - one + 2 * other).max() < 1e-5 * np.abs(both).max()  # float32
