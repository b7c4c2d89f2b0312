"""Forward mode against central differences of the float64 twin of the same kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.materials import Material
from waveformer.simulator.matter_parameters import changed
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.numerics import DIFFERENTIABLE
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.quadrature import SurfaceSamples, sample_surface, take
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.reference_frozen import FrozenTwin
from waveformer.simulator.response_plan import WallChange, plan_response
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.tessellation import tessellate

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 3.6e9, 8)
GRID = Aperture.planar_grid(6, 6, 0.006)
PAIRS = Aperture(GRID.tx_m, GRID.tx_m + [0.02, -0.01, 0.0])
SHEET = Sheet((0.0, 0.0, -0.1), (0.1, 0.0, 1.0), 0.003, 2 - 0.1j)


@pytest.fixture(scope="module")
def plate() -> Any:
    mesh = primitives.plate(0.018, 0.015, 0.003)
    mesh.vertices[:, 2] += 0.001 * np.sin(300 * mesh.vertices[:, 0]) - 0.26
    return load_mesh(mesh)


def frozen(plate: Any, aperture: Aperture) -> tuple[Any, Any, SurfaceSamples]:
    """The frozen surface of a wavy plate, its twin's scene, its samples."""
    from waveformer.simulator.differentiable import FrozenScene
    from waveformer.simulator.echo_source import EchoSource
    from waveformer.simulator.frozen import FrozenTarget, freeze_source
    from waveformer.simulator.scene import build_scene

    samples = sample_surface(plate, np.eye(4), 0.0013)
    scene = build_scene([(plate.vertices_m, plate.faces)])
    source = EchoSource(samples, True, 0.24)
    surface, index = freeze_source(scene, source, CHIRP, aperture, Surroundings(), "none", DIFFERENTIABLE)  # type: ignore[misc]
    target = FrozenTarget(surface, tessellate(plate, 0.0013).take(index))
    return (
        surface,
        FrozenScene(plate.faces, [target], [], CHIRP, DIFFERENTIABLE, {}),
        take(samples, index),
    )


@pytest.mark.parametrize("aperture", [GRID, PAIRS], ids=["monostatic", "pairs"])
def test_motions(plate: Any, aperture: Aperture) -> None:
    from waveformer.simulator.tangent_echo import Direction

    surface, scene, samples = frozen(plate, aperture)
    term = surface.echo(samples, CHIRP, aperture, None, -1j / (4.0 * np.pi))
    twin, step = FrozenTwin.at(scene, plate.vertices_m, aperture), 1e-7
    for axis in np.eye(3):
        moved_samples = np.zeros((len(samples.points_m), 8))
        moved_samples[:, :3] = axis
        directions = [Direction(samples=moved_samples), Direction(transmitters_m=axis)]
        if aperture.rx_m is not None:
            directions.append(Direction(receivers_m=axis))
        for number, direction in enumerate(directions):
            ends = []
            for sign in (-1.0, 1.0):
                shifts = [sign * step * axis * (number == which) for which in range(3)]
                receivers = None if aperture.rx_m is None else aperture.rx_m + shifts[2]
                ends.append(
                    twin.echo(plate.vertices_m + shifts[0], Aperture(aperture.tx_m + shifts[1], receivers))
                )
            slope = (ends[1] - ends[0]) / (2 * step)
            error = np.linalg.norm(term.derivative(direction) - slope) / np.linalg.norm(slope)
            # float32 and the tolerance of the interpolations, which a derivative takes twice
            assert error < 2e-4, (axis, number, error)


@pytest.mark.parametrize("change", [
    WallChange(None, "real"), WallChange(None, "imaginary"), WallChange(None, "thickness"),
    WallChange(None, "roughness"), WallChange(0, "real"), WallChange(0, "imaginary"), WallChange(0, "thickness"),
])  # fmt: skip
def test_matter(plate: Any, change: WallChange) -> None:
    from waveformer.simulator.tangent_echo import Direction

    few = Aperture(PAIRS.tx_m[::12], PAIRS.receivers_m[::12])
    surface, scene, samples = frozen(plate, few)
    material, surroundings = Material.dielectric(3 - 0.2j, 0.002, 2e-4), Surroundings(sheets=(SHEET,))
    bounds = np.array([samples.points_m.min(axis=0), samples.points_m.max(axis=0)])
    antennas = np.concatenate([few.tx_m, few.receivers_m])
    plan = plan_response(
        material, surroundings, "none", CHIRP, DIFFERENTIABLE.tolerance, bounds, antennas,
        neighbours=[changed(material, surroundings, change)[:2]],
    )  # fmt: skip
    term = surface.echo(samples, CHIRP, few, plan, 1j / (4.0 * np.pi))
    twin = FrozenTwin.at(scene, plate.vertices_m, few)
    ends, step = [], 0.0
    for sign in (-0.1, 0.1):
        *matter, step = changed(material, surroundings, change, sign)
        ends.append(twin.echo(plate.vertices_m, few, *matter))
    slope = (ends[1] - ends[0]) / (2 * step)
    error = np.linalg.norm(term.derivative(Direction(matter=((change, 1.0),))) - slope) / np.linalg.norm(
        slope
    )
    # tables that are linear between their entries, and a path factor that is log-linear over a cell
    assert error < 5e-4


def test_nothing_changes_along_a_number_that_the_echo_does_not_know(plate: Any) -> None:
    from waveformer.simulator.tangent_echo import Direction

    surface, _, samples = frozen(plate, GRID)
    term = surface.echo(samples, CHIRP, GRID, None, 1.0)
    assert not term.derivative(Direction(matter=((WallChange(None, "roughness"), 1.0),))).any()


def test_several_numbers_change_at_their_rates(plate: Any) -> None:
    from waveformer.simulator.tangent_echo import Direction

    few = Aperture(PAIRS.tx_m[::12], PAIRS.receivers_m[::12])
    surface, _, samples = frozen(plate, few)
    material, surroundings = Material.dielectric(3 - 0.2j, 0.002, 2e-4), Surroundings(sheets=(SHEET,))
    bounds = np.array([samples.points_m.min(axis=0), samples.points_m.max(axis=0)])
    plan = plan_response(material, surroundings, "none", CHIRP, 1e-4, bounds, few.tx_m)
    term = surface.echo(samples, CHIRP, few, plan, 1j / (4.0 * np.pi))
    rates = (
        (WallChange(None, "real"), 0.5),
        (WallChange(None, "roughness"), 1e-4),
        (WallChange(0, "thickness"), -1e-3),
    )
    apart = [rate * term.derivative(Direction(matter=((change, 1.0),))) for change, rate in rates]
    together = term.derivative(Direction(matter=rates))
    assert np.abs(together - sum(apart)).max() < 1e-5 * np.abs(together).max()  # float32
