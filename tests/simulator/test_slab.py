"""The textbook slab: energy, Brewster's angle, windows, limits, and the sum of its inner echoes."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.slab import (
    coherent_loss,
    fresnel_reflection,
    refraction_factor,
    slab_reflection,
    slab_transmission,
)

FREQUENCIES_HZ = np.linspace(77.5e9, 80.5e9, 7)
COSINES = np.cos(np.radians([0, 10, 30, 45, 60, 80, 89]))[:, None]
WAVELENGTH_M = SPEED_OF_LIGHT_M_PER_S / 79e9
# a dozen operations in double precision
ROUNDING = 1e-12


@pytest.mark.parametrize("permittivity", [1.5, 2.7, 9.8])
@pytest.mark.parametrize("thickness_m", [0.1e-3, 3e-3, 10e-3])
def test_a_lossless_slab_loses_nothing(permittivity, thickness_m):
    slab = permittivity, thickness_m, COSINES, FREQUENCIES_HZ
    for back, through in zip(slab_reflection(*slab), slab_transmission(*slab), strict=True):
        assert back.shape == through.shape == (7, 7)
        assert_allclose(np.abs(back) ** 2 + np.abs(through) ** 2, 1, atol=ROUNDING)


@pytest.mark.parametrize("permittivity", [1.5 - 0.05j, 2 - 0.1j, 6 - 3j, 1 - 2e6j])
def test_a_lossy_slab_keeps_some(permittivity):
    slab = permittivity, 3e-3, COSINES, FREQUENCIES_HZ
    for back, through in zip(slab_reflection(*slab), slab_transmission(*slab), strict=True):
        energy = np.abs(back) ** 2 + np.abs(through) ** 2
        assert (energy < 1).all()
        assert (energy > 0).all()


def test_loss_in_the_slab_is_that_of_the_wave_in_it():
    """Where faces send nothing back (Brewster) only exp(-2 k d Im q) of the power is left."""
    eps, thickness = 2.7 - 0.002j, 8e-3
    cosine = 1 / np.sqrt(1 + eps.real)
    k = 2 * np.pi / WAVELENGTH_M
    decay = np.exp(k * thickness * np.sqrt(eps - 1 + cosine**2).imag)
    through = slab_transmission(eps, thickness, cosine, 79e9).p
    # the faces' remaining reflection is a quarter of the loss tangent
    assert_allclose(np.abs(through), decay, rtol=1e-6)


def test_brewster_angle():
    for eps in (1.5, 2.7, 6.31):
        cosine = 1 / np.sqrt(1 + eps)  # tan = sqrt(eps)
        assert abs(fresnel_reflection(eps, cosine).p) < ROUNDING
        assert np.abs(slab_reflection(eps, 3e-3, cosine, FREQUENCIES_HZ).p).max() < ROUNDING
        # the phase counts from the air's: k d (cos - q)
        assert_allclose(np.abs(slab_transmission(eps, 3e-3, cosine, FREQUENCIES_HZ).p), 1, atol=ROUNDING)
        assert abs(fresnel_reflection(eps, cosine).s) > 0.1


def test_half_wave_window_and_quarter_wave_mirror():
    """At d = lambda / 2n the slab is a window, at lambda / 4n its reflection is largest: (1 - eps) / (1 + eps)."""
    eps = 2.7
    quarter = WAVELENGTH_M / (4 * np.sqrt(eps))
    assert abs(slab_reflection(eps, 2 * quarter, 1.0, 79e9).s) < ROUNDING
    assert_allclose(slab_reflection(eps, quarter, 1.0, 79e9).s, (1 - eps) / (1 + eps), atol=ROUNDING)


def test_a_conductor_is_the_limit():
    for value in (*fresnel_reflection(1 - 1e10j, COSINES), *slab_reflection(1 - 1e10j, 1e-3, COSINES, 79e9)):
        # 2 cos / |m| in s, 2 / (|m| cos) in p: at 89 degrees 57 * 2e-5
        assert np.abs(value + 1).max() < 1.2e-3
    assert np.abs(slab_transmission(1 - 1e10j, 1e-3, COSINES, 79e9)).max() < 1e-100


def test_permittivity_one_vanishes_exactly():
    for value in (*fresnel_reflection(1.0, COSINES), *slab_reflection(1.0, 3e-3, COSINES, FREQUENCIES_HZ)):
        assert (value == 0).all()
    for value in slab_transmission(1.0, 3e-3, COSINES, FREQUENCIES_HZ):
        assert_allclose(value, 1, rtol=0, atol=ROUNDING)
    assert_allclose(refraction_factor(1.0, 3e-3, COSINES, 0.4, FREQUENCIES_HZ), 1, rtol=0, atol=ROUNDING)


def test_both_polarisations_are_one_at_normal_incidence():
    for pair in (
        fresnel_reflection(2.7 - 0.1j, 1.0),
        slab_reflection(2.7 - 0.1j, 3e-3, 1.0, FREQUENCIES_HZ),
        slab_transmission(2.7 - 0.1j, 3e-3, 1.0, FREQUENCIES_HZ),
    ):
        assert_allclose(pair.s, pair.p, rtol=ROUNDING)
    assert fresnel_reflection(4.0, 1.0).s == -1 / 3


@pytest.mark.parametrize("polarisation", ["s", "p"])
def test_the_closed_form_is_the_sum_of_all_inner_echoes(polarisation):
    """Ray by ray: in through the first face, to and fro, out; 60 echoes of a slab that loses 40 % on each."""
    eps, thickness, cosine, frequency = 4 - 0.2j, 4e-3, np.cos(0.6), 79e9
    k = 2 * np.pi * frequency / SPEED_OF_LIGHT_M_PER_S
    once = np.exp(-1j * k * thickness * np.sqrt(eps - 1 + cosine**2))
    into = getattr(fresnel_reflection(eps, cosine), polarisation)
    # Stokes: the face seen from inside sends back -into, and the two transmissions multiply to 1 - into^2
    both = 1 - into**2
    back, through, inner = into, 0.0, both * once
    for _ in range(60):
        through = through + inner
        inner = inner * -into * once
        back = back + inner
        inner = inner * -into * once
    through = through * np.exp(1j * k * thickness * cosine)
    slab = eps, thickness, cosine, frequency
    assert_allclose(getattr(slab_reflection(*slab), polarisation), back, rtol=ROUNDING)
    assert_allclose(getattr(slab_transmission(*slab), polarisation), through, rtol=ROUNDING)


def test_a_thin_sheet_delays_by_its_excess_path():
    """Phase of a nearly invisible slab: -k d (n - 1), to the order of its reflection squared."""
    eps, thickness = 1.02, 5e-3
    through = slab_transmission(eps, thickness, 1.0, 79e9).s
    expected = -2 * np.pi / WAVELENGTH_M * thickness * (np.sqrt(eps) - 1)
    assert_allclose(np.angle(through), expected, atol=((np.sqrt(eps) - 1) / 2) ** 2)


def test_rough_surfaces_keep_less():
    """Ament: exp(-(2 k sigma cos)^2) of the power."""
    k = 2 * np.pi / WAVELENGTH_M
    assert_allclose(
        coherent_loss(0.3e-3, 0.8, 79e9) ** 2, np.exp(-((2 * k * 0.3e-3 * 0.8) ** 2)), rtol=ROUNDING
    )
    assert coherent_loss(0.0, 0.5, 79e9) == 1
