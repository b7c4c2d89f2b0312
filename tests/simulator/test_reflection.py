"""The Dr.Jit coefficients against their NumPy twin."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from waveformer.simulator import slab
from waveformer.simulator.permittivity import PERMITTIVITIES, lookup_permittivity
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S

FREQUENCY_HZ = 79e9
WAVENUMBER_PER_M = 2 * np.pi * FREQUENCY_HZ / SPEED_OF_LIGHT_M_PER_S
COSINES = np.cos(np.radians(np.linspace(0, 85, 60)))
# single precision, 6e-8, after some twenty operations
SINGLE = 2e-6

pytestmark = pytest.mark.usefixtures("mitsuba_variant")


def coefficients(permittivity, thickness_m, cosines=COSINES):
    """The kernel's four coefficients as NumPy arrays; None stays."""
    import mitsuba as mi

    from waveformer.simulator.reflection import complex_number, wall_coefficients

    eps = complex_number(mi.Float(permittivity.real), mi.Float(permittivity.imag))
    thickness = None if thickness_m is None else mi.Float(thickness_m)
    values = wall_coefficients(
        eps, thickness, mi.Float(cosines.astype(np.float32)), mi.Float(WAVENUMBER_PER_M)
    )
    return [None if value is None else value.real.numpy() + 1j * value.imag.numpy() for value in values]


@pytest.mark.parametrize("permittivity", [1.0 + 0j, 1.5 - 0.05j, 2.7 + 0j, 6 - 3j, 9.8 - 0.0049j, 1 - 2e6j])
def test_half_space(permittivity):
    s, p, through_s, through_p = coefficients(permittivity, None)
    twin = slab.fresnel_reflection(permittivity, COSINES.astype(np.float32))
    # near Brewster's angle p is a difference of numbers near 1, so the bound is absolute
    assert_allclose(s, twin.s, rtol=0, atol=SINGLE)
    assert_allclose(p, twin.p, rtol=0, atol=SINGLE)
    assert through_s is None
    assert through_p is None


@pytest.mark.parametrize("permittivity", [1.0 + 0j, 1.5 - 0.05j, 2.7 + 0j, 6 - 3j, 9.8 - 0.0049j])
@pytest.mark.parametrize("thickness_m", [0.1e-3, 3e-3, 20e-3])
def test_slab(permittivity, thickness_m):
    back_s, back_p, through_s, through_p = coefficients(permittivity, thickness_m)
    case = permittivity, thickness_m, COSINES.astype(np.float32), FREQUENCY_HZ
    back, through = slab.slab_reflection(*case), slab.slab_transmission(*case)
    # the phase 2 k d n is rounded with its own size; a ring 1 / (1 - gamma^2) makes it larger, by 40 where gamma^2 of
    # the largest permittivity at 85 degrees is 0.975
    faces = slab.fresnel_reflection(permittivity, case[2])
    phase = 1 + 2 * WAVENUMBER_PER_M * thickness_m * abs(np.sqrt(permittivity))
    for value, twin, face in (
        (back_s, back.s, faces.s),
        (back_p, back.p, faces.p),
        (through_s, through.s, faces.s),
        (through_p, through.p, faces.p),
    ):
        bound = (SINGLE + 1.2e-7 * phase) / np.abs(1 - np.abs(face) ** 2)
        assert (np.abs(value - twin) < bound).all()


def test_permittivity_one_vanishes():
    back_s, back_p, through_s, through_p = coefficients(1.0 + 0j, 5e-3)
    # far below the -60 dB asked of a box of air
    assert max(np.abs(back_s).max(), np.abs(back_p).max()) < 1e-6
    assert_allclose(through_s, 1, rtol=0, atol=SINGLE)
    assert_allclose(through_p, 1, rtol=0, atol=SINGLE)


def test_grazing_incidence_stays_finite():
    for thickness_m in (None, 3e-3):
        values = coefficients(2.7 - 0.02j, thickness_m, np.array([0.0, 1e-6]))
        for value in values:
            assert value is None or np.isfinite(value).all()
        assert_allclose(values[0], -1, atol=1e-3)  # the clamp's cosine, 1e-4, times 2 / sqrt(eps - 1)


@pytest.mark.parametrize("name", sorted(PERMITTIVITIES))
def test_each_material_reflects_as_fresnel(name):
    """Asked: 0.05 dB of (1 - sqrt eps) / (1 + sqrt eps) at normal incidence, in the kernel and in the twin."""
    eps = lookup_permittivity(name).at(FREQUENCY_HZ)
    fresnel = abs((1 - np.sqrt(eps)) / (1 + np.sqrt(eps)))
    kernel = coefficients(eps, None, np.array([1.0]))
    for value in (kernel[0][0], kernel[1][0], *slab.fresnel_reflection(eps, 1.0)):
        assert abs(20 * np.log10(abs(value) / fresnel)) < 0.001


def test_rough_surface():
    import mitsuba as mi

    from waveformer.simulator.reflection import coherent_loss

    cosines = COSINES.astype(np.float32)
    kept = coherent_loss(mi.Float(0.3e-3), mi.Float(cosines), mi.Float(WAVENUMBER_PER_M)).numpy()
    assert_allclose(kept, slab.coherent_loss(0.3e-3, cosines, FREQUENCY_HZ), rtol=SINGLE)
