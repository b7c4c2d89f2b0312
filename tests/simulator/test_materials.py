"""Materials as objects: what they hold, say and refuse."""

import dataclasses

import pytest

from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.permittivity import lookup_permittivity


def test_a_conductor_has_no_permittivity():
    conductor = Material.pec(roughness_m=0.1e-3)
    assert conductor.is_conductor
    assert conductor.permittivity is None
    assert conductor.describe(79e9) == {"name": "pec", "roughness_m": 0.1e-3}


def test_a_dielectric_says_what_it_is():
    wall = Material.dielectric(2.7 - 0.02j, thickness_m=2e-3)
    assert not wall.is_conductor
    assert wall.describe(79e9) == {
        "name": "dielectric",
        "roughness_m": 0.0,
        "permittivity": [2.7, -0.02],
        "thickness_m": 2e-3,
    }


def test_a_named_material_takes_the_value_of_the_table_at_the_frequency_asked():
    wood = Material.named("wood", thickness_m=5e-3, roughness_m=0.2e-3)
    assert wood.permittivity is lookup_permittivity("wood")
    expected = lookup_permittivity("wood").at(77e9)
    assert wood.describe(77e9)["permittivity"] == [expected.real, expected.imag]
    assert wood.describe(77e9)["permittivity"] != wood.describe(81e9)["permittivity"]


def test_a_half_space_has_no_thickness():
    assert Material.dielectric(6 - 3j).thickness_m is None
    assert Material.named("glass").describe(79e9)["thickness_m"] is None


@pytest.mark.parametrize("thickness_m", [0.0, -1e-3, 1.5, float("nan"), float("inf")])
def test_impossible_thickness_is_refused(thickness_m):
    with pytest.raises(RadarError, match="thickness_m"):
        Material.dielectric(2.7, thickness_m=thickness_m)


@pytest.mark.parametrize("roughness_m", [-1e-6, 0.02, float("nan")])
def test_impossible_roughness_is_refused(roughness_m):
    with pytest.raises(RadarError, match="roughness_m"):
        Material.pec(roughness_m=roughness_m)


def test_gain_is_refused():
    with pytest.raises(RadarError, match="eps'' >= 0"):
        Material.dielectric(2.7 + 0.1j)


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(RadarError, match=r"'steel'; known: .*metal"):
        Material.named("steel")


def test_materials_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Material.pec().roughness_m = 1.0
