"""The table of materials and the law of ITU-R P.2040."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from waveformer.simulator.errors import RadarError
from waveformer.simulator.permittivity import PERMITTIVITIES, Permittivity, lookup_permittivity

VACUUM_PERMITTIVITY = 8.8541878128e-12


def test_conductivity_becomes_loss():
    """eps'' = sigma / (2 pi f eps_0); the recommendation rounds the constant to 17.98."""
    value = Permittivity(2.0, 0.0, 0.5, 0.0).at(79e9)
    assert value.real == 2.0
    assert_allclose(-value.imag, 0.5 / (2 * np.pi * 79e9 * VACUUM_PERMITTIVITY), rtol=5e-4)


def test_powers_of_the_frequency():
    law = Permittivity(15.0, -0.1, 0.035, 1.63)  # ITU-R P.2040-3, table 3, medium dry ground
    value = law.at(10e9)
    assert_allclose(value.real, 15 * 10**-0.1)
    assert_allclose(-value.imag, 17.98 * 0.035 * 10**0.63)


def test_a_constant_does_not_depend_on_frequency():
    law = Permittivity.constant(1.5 - 0.05j)
    assert law.at(1e9) == law.at(80e9) == 1.5 - 0.05j


@pytest.mark.parametrize("value", [0.9, 1.5 + 0.05j, float("nan"), complex("inf"), "air", None])
def test_impossible_values_are_refused(value):
    with pytest.raises(RadarError, match=r"so 1\.5-0\.05j"):
        Permittivity.constant(value)


def test_the_materials_asked_for_are_there():
    asked = {"metal", "cardboard", "wood", "abs", "glass", "ceramic", "foam", "rubber", "plastic"}
    assert asked <= set(PERMITTIVITIES)


@pytest.mark.parametrize(
    ("name", "value"),
    # ITU-R P.2040-3, table 3, by hand at 79 GHz: eps' and sigma = c f^d, eps'' = 17.98 sigma / f
    [("wood", 1.99 - 0.1157j), ("glass", 6.31 - 0.2852j), ("acrylic", 2.58 - 0.0311j)],
)
def test_recommended_values_at_79_ghz(name, value):
    assert_allclose(lookup_permittivity(name).at(79e9), value, rtol=0, atol=6e-5)


def test_cardboard_is_wood_and_air_in_halves():
    """Mixed by volume: half the susceptibility of wood."""
    assert_allclose(lookup_permittivity("cardboard").at(79e9), (lookup_permittivity("wood").at(79e9) + 1) / 2)


def test_metal_is_nearly_a_perfect_conductor():
    eps = lookup_permittivity("metal").at(79e9)
    assert abs((1 - np.sqrt(eps)) / (1 + np.sqrt(eps)) + 1) < 2e-3


@pytest.mark.parametrize("name", sorted(PERMITTIVITIES))
def test_every_material_is_passive(name):
    for frequency_hz in (60e9, 77e9, 81e9):
        value = lookup_permittivity(name).at(frequency_hz)
        assert value.real >= 1
        assert value.imag < 0


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(RadarError, match=r"unobtainium.*abs.*wood"):
        lookup_permittivity("unobtainium")
