"""Numbers of the matter that are tensors: which of them are followed, and what the forward model is given."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.autograd import forward_ad

from waveformer.simulator import occluders
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.matter_parameters import Box, Matter, Sheet, changed
from waveformer.simulator.response_plan import WallChange
from waveformer.simulator.surroundings import Surroundings

PLACE: tuple[Any, Any] = ((0, 0, -0.1), (0, 0, 1))
CORNERS: tuple[Any, Any] = ((-0.1, -0.1, -0.4), (0.1, 0.1, -0.2))


def variable(value: complex) -> torch.Tensor:
    dtype = torch.complex128 if isinstance(value, complex) else torch.float64
    return torch.tensor(value, dtype=dtype, requires_grad=True)


def around(matter: Matter) -> Surroundings:
    return matter.surroundings(Antenna.isotropic(), (0.0, 1.0, 0.0))


def test_every_number_with_a_gradient_is_named() -> None:
    sheets = (
        Sheet(*PLACE, 0.003, "abs"),
        Sheet(*PLACE, variable(0.004), variable(2 - 0.1j)),
        occluders.Sheet(*PLACE, 0.002, 3.0),
    )
    box = Box(*CORNERS, variable(0.005), variable(1.5))
    matter = Matter(variable(3 - 0.2j), variable(0.002), variable(1e-4), sheets, box)
    values = {tuple(change): float(number.detach()) for change, number in matter.variables()}
    assert values == {
        (None, "real"): 3.0, (None, "imaginary"): -0.2, (None, "thickness"): 0.002, (None, "roughness"): 1e-4,
        (1, "real"): 2.0, (1, "imaginary"): -0.1, (1, "thickness"): 0.004, (3, "real"): 1.5, (3, "thickness"): 0.005,
    }  # fmt: skip


def test_constants_are_not_followed() -> None:
    tensors = Matter(torch.tensor(3 - 0.2j), torch.tensor(0.002), torch.tensor(1e-4), (), None)
    assert list(tensors.variables()) == []
    assert list(Matter("glass", None, 0.0, (), None).variables()) == []


def test_a_tangent_is_followed() -> None:
    with forward_ad.dual_level():
        roughness = forward_ad.make_dual(torch.tensor(1e-4), torch.tensor(1.0))
        assert [change for change, _ in Matter(None, None, roughness, (), None).variables()] == [
            WallChange(None, "roughness")
        ]


def test_the_forward_model_gets_plain_numbers() -> None:
    sheet, box = (
        Sheet(*PLACE, variable(0.004), variable(2 - 0.1j), True),
        Box(*CORNERS, variable(0.005), "abs"),
    )
    matter = Matter(variable(3 - 0.2j), variable(0.002), variable(1e-4), (sheet,), box)
    assert matter.material() == Material.dielectric(3 - 0.2j, 0.002, 1e-4)
    surroundings = around(matter)
    (made,) = surroundings.sheets
    assert (made.thickness_m, made.permittivity, made.echo) == (0.004, 2 - 0.1j, True)
    assert surroundings.box is not None
    assert (surroundings.box.thickness_m, surroundings.box.permittivity) == (0.005, "abs")
    assert Matter(None, None, 2e-4, (), None).material() == Material.pec(2e-4)
    assert Matter("glass", 0.003, 0.0, (), None).material() == Material.named("glass", 0.003)


@pytest.mark.parametrize(
    ("matter", "message"),
    [
        (Matter(None, 0.003, 0.0, (), None), "thickness_m needs a permittivity"),
        (Matter(torch.ones(2), None, 0.0, (), None), "permittivity must be one number"),
        (Matter(3.0, torch.ones(2), 0.0, (), None), "thickness_m must be one real number"),
        (Matter(None, None, torch.tensor(1j), (), None), "roughness_m must be one real number"),
        (Matter(None, None, -1e-4, (), None), "roughness_m must lie in"),
    ],
)
def test_what_is_no_number_is_refused(matter: Matter, message: str) -> None:
    with pytest.raises(RadarError, match=f"^(material )?{message}"):
        matter.material()


MATERIAL = Material.dielectric(3 - 0.2j, 0.002, 1e-4)
SURROUNDINGS = Surroundings(
    sheets=(occluders.Sheet(*PLACE, 0.004, 2 - 0.1j, True), occluders.Sheet(*PLACE, 0.003, "abs")),
    box=occluders.Box(*CORNERS, 0.005, 1.5 - 0.1j),
)
WALLS = [None, 0, 2]


def number_of(material: Material, surroundings: Surroundings, change: WallChange) -> float:
    walls = [sheet.material for sheet in surroundings.sheets]
    if surroundings.box is not None:
        walls.append(surroundings.box.material)
    wall = material if change.wall is None else walls[change.wall]
    assert wall.permittivity is not None
    value = wall.permittivity.at(77e9)
    numbers = {"real": value.real, "imaginary": value.imag, "thickness": wall.thickness_m}
    return float((numbers | {"roughness": wall.roughness_m})[change.component] or 0.0)


@pytest.mark.parametrize("wall", WALLS)
@pytest.mark.parametrize("component", ["real", "imaginary", "thickness", "roughness"])
@pytest.mark.parametrize("steps", [1.0, -0.1])
def test_one_number_moves_by_the_step_and_no_other(wall: int | None, component: Any, steps: float) -> None:
    if component == "roughness" and wall is not None:
        return  # walls are smooth
    change = WallChange(wall, component)
    material, surroundings, step = changed(MATERIAL, SURROUNDINGS, change, steps)
    # eps'' is minus the imaginary part, and matter is moved to more loss
    assert step * steps * (-1 if component == "imaginary" else 1) > 0
    for other in (
        WallChange(w, c) for w in [*WALLS, 1] for c in ("real", "imaginary", "thickness", "roughness")
    ):
        before, after = (
            number_of(*matter, other) for matter in ((MATERIAL, SURROUNDINGS), (material, surroundings))
        )
        expected = step if other == change else 0.0
        assert after - before == pytest.approx(expected, rel=1e-6, abs=1e-15), other
    assert [sheet.echo for sheet in surroundings.sheets] == [True, False]


def test_a_named_wall_stays_named_while_its_thickness_moves() -> None:
    _, surroundings, _ = changed(MATERIAL, SURROUNDINGS, WallChange(1, "thickness"))
    assert surroundings.sheets[1].permittivity == "abs"


def test_the_roughness_of_a_smooth_surface_has_a_step() -> None:
    material, _, step = changed(Material.pec(), Surroundings(), WallChange(None, "roughness"))
    assert material.roughness_m == step > 0
