"""The gradients on real objects, everything that the model can be asked for: minutes, so not on every change."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.numerics import DIFFERENTIABLE
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.reference_gradient import GradientCase

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("mitsuba_variant")]

# 14 samples see as far as 0.58 m.
CHIRP = Chirp(77e9, 3.6e9, 14)
GRID, FEW = Aperture.planar_grid(6, 6, 0.012).tx_m, Aperture.planar_grid(2, 2, 0.04).tx_m
OFFSET = np.array([0.03, 0.0, 0.0])
FINAL = ("reflectivity", "antenna_gain_db", "range_bias_m")
SHEET = (2.2 - 0.05j, 0.004)
# The twin needs a while for matter. How finely a surface is cut does not matter for what is compared.
COARSE = DIFFERENTIABLE.model_copy(update={"spacing_wavelengths": 0.7})
Make = Callable[..., GradientCase]


@pytest.fixture(params=["sphere", "ycb/025_mug.ply", "ycb/035_power_drill.ply"])
def make(request: pytest.FixtureRequest) -> Make:
    """Makes cases with one object 0.4 m below the aperture."""
    mesh: SurfaceMesh
    if request.param == "sphere":
        mesh = load_mesh(primitives.sphere(0.03, 0.003))
    else:
        folder: Path = request.getfixturevalue("shared_meshes")
        mesh = load_mesh(folder / request.param)
    middle = 0.5 * (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0))
    vertices = mesh.vertices_m - middle - [0.0, 0.0, 0.4]

    def case(tx_m: np.ndarray, **settings: Any) -> GradientCase:
        return GradientCase(vertices, mesh.faces, CHIRP, tx_m, **settings)

    return case


def test_vertices_and_antennas(make: Make) -> None:
    assert make(GRID).misses("vertices", "tx_m", *FINAL) == {}


def test_pairs(make: Make) -> None:
    case = make(GRID, rx_m=GRID + OFFSET)
    assert case.misses("vertices", "tx_m", "rx_m", *FINAL) == {}


def test_matter(make: Make) -> None:
    case = make(FEW, permittivity=3 - 0.2j, roughness_m=2e-4, mode=COARSE)
    assert case.misses("vertices", "tx_m", "permittivity", "roughness_m", *FINAL) == {}


def test_through_a_sheet(make: Make) -> None:
    case = make(FEW, sheet=SHEET, mode=COARSE)
    assert case.misses("vertices", "tx_m", "sheet permittivity", "sheet thickness_m", *FINAL) == {}


def test_pairs_of_rough_matter_through_a_sheet(make: Make) -> None:
    settings: dict[str, Any] = {"permittivity": 3 - 0.2j, "roughness_m": 2e-4, "sheet": SHEET, "mode": COARSE}
    case = make(FEW, rx_m=FEW + OFFSET, **settings)
    matter = ("permittivity", "roughness_m", "sheet permittivity", "sheet thickness_m")
    assert case.misses("vertices", "tx_m", "rx_m", *matter) == {}


def test_the_echo_of_a_box_itself() -> None:
    mesh = primitives.sphere(0.008, 0.0022)
    mesh.apply_translation([0.005, 0.003, -0.25])
    case = GradientCase(
        np.array(mesh.vertices),
        np.array(mesh.faces),
        Chirp(77e9, 3.6e9, 8),
        FEW[:1],
        box=SHEET,
        box_echo=True,
    )
    assert case.misses("tx_m", "box permittivity", "box thickness_m", "antenna_gain_db") == {}
