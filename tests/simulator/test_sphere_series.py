"""The exact sphere: sign, limits, reciprocity, and an independent Mie code."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from waveformer.simulator.closed_forms import sphere_optics
from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.slab import fresnel_reflection
from waveformer.simulator.sphere_series import _coefficients, sphere_echo, sphere_rcs_m2

FREQUENCIES_HZ = np.linspace(77e9, 81e9, 9)
ORIGIN = [[0.0, 0.0, 0.0]]


def frequency_of(ka, radius_m=1.0):
    return np.atleast_1d(ka) * SPEED_OF_LIGHT_M_PER_S / (2 * np.pi * radius_m)


@pytest.mark.parametrize(
    ("radius_m", "max_db", "max_deg"),
    [(0.1, 1e-3, 0.1), (0.05, 0.01, 0.4), (0.03, 0.02, 1.0), (0.02, 0.08, 1.5)],
)
def test_large_sphere_approaches_optics(radius_m, max_db, max_deg):
    """Also fixes the overall sign: -(a/2) exp(-2jk(d-a)) / ((d-a) d) at the specular point."""
    exact = sphere_echo(radius_m, [0, 0, -0.4], ORIGIN, None, FREQUENCIES_HZ)[0]
    ratio = exact / sphere_optics(radius_m, 0.4, FREQUENCIES_HZ)
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < max_db
    assert np.abs(np.degrees(np.angle(ratio))).max() < max_deg


def test_known_far_field_cross_sections():
    assert_allclose(sphere_rcs_m2(1.0, frequency_of(1.028)) / np.pi, 3.6550, atol=1e-4)  # first resonance
    assert_allclose(sphere_rcs_m2(1.0, frequency_of(1000.0)) / np.pi, 1.0, atol=1e-6)
    # Rayleigh: sigma / pi a^2 = 9 (ka)^4
    assert_allclose(sphere_rcs_m2(1.0, frequency_of(0.02)) / np.pi, 9 * 0.02**4, rtol=2e-3)


@pytest.mark.parametrize("ka", [0.5, 1.0, 10.0, 33.0, 83.0, 166.0, 200.0])
def test_cross_section_agrees_with_miepython(ka):
    miepython = pytest.importorskip("miepython")
    backscatter = miepython.efficiencies_mx(-1e9j, ka)[2]
    assert_allclose(sphere_rcs_m2(1.0, frequency_of(ka))[0] / np.pi, backscatter, rtol=1e-6)


def test_far_dipoles_see_the_far_field_cross_section():
    distance = 500.0
    h = sphere_echo(0.05, [0, 0, -distance], ORIGIN, None, FREQUENCIES_HZ)[0]
    wavelengths = SPEED_OF_LIGHT_M_PER_S / FREQUENCIES_HZ
    rcs = np.abs(h) ** 2 * (4 * np.pi) ** 3 * distance**4 / wavelengths**2
    assert np.abs(10 * np.log10(rcs / sphere_rcs_m2(0.05, FREQUENCIES_HZ))).max() < 2e-3


def test_reciprocity():
    rng = np.random.default_rng(1)
    tx, rx = (np.column_stack([rng.uniform(-0.2, 0.2, (20, 2)), rng.uniform(0, 0.2, 20)]) for _ in "ab")
    forth = sphere_echo(0.05, [0.01, 0, -0.3], tx, rx, FREQUENCIES_HZ)
    assert_allclose(sphere_echo(0.05, [0.01, 0, -0.3], rx, tx, FREQUENCIES_HZ), forth, rtol=1e-12)


def test_monostatic_is_the_pair_at_one_place():
    antennas = np.random.default_rng(2).uniform(-0.1, 0.1, (5, 3))
    alone = sphere_echo(0.03, [0, 0, -0.4], antennas, None, FREQUENCIES_HZ)
    assert_allclose(sphere_echo(0.03, [0, 0, -0.4], antennas, antennas, FREQUENCIES_HZ), alone, rtol=1e-12)


def test_bistatic_echo_meets_the_optical_path_and_divergence():
    """Away from backscatter the specular point of a large sphere gives phase and level of optics."""
    radius, distance, half = 0.1, 0.5, np.radians(15)
    tx, rx = (distance * np.array([[s * np.sin(half), 0, np.cos(half)]]) for s in (1, -1))
    h = sphere_echo(radius, [0, 0, 0], tx, rx, FREQUENCIES_HZ)[0]
    point = np.array([0, 0, radius])  # symmetric geometry: reflection at the pole
    leg = np.linalg.norm(tx[0] - point)
    cos_i = (tx[0] - point)[2] / leg
    # Divergence of a mirror with curvature 1/a in both planes, astigmatic at oblique incidence
    spread = (1 + leg / (radius * cos_i)) * (1 + leg * cos_i / radius)
    wavelengths = SPEED_OF_LIGHT_M_PER_S / FREQUENCIES_HZ
    optics = -wavelengths / (4 * np.pi * 2 * leg) / np.sqrt(spread) * np.exp(-4j * np.pi * leg / wavelengths)
    assert np.abs(20 * np.log10(np.abs(h / optics))).max() < 0.02
    assert np.abs(np.degrees(np.angle(h / optics))).max() < 0.5


def test_one_series_serves_a_wide_band():
    """Orders that only the highest frequency needs must not spoil the lowest."""
    band = frequency_of([0.1, 1.0, 100.0], 0.05)
    together = sphere_echo(0.05, [0, 0, -0.4], ORIGIN, None, band)[0]
    alone = [sphere_echo(0.05, [0, 0, -0.4], ORIGIN, None, [f])[0, 0] for f in band]
    assert np.isfinite(together).all()
    assert_allclose(together, alone, rtol=1e-12)


def test_antenna_inside_the_sphere_is_refused():
    with pytest.raises(RadarError, match="outside the sphere"):
        sphere_echo(0.05, [0, 0, 0], [[0, 0, 0.04]], None, FREQUENCIES_HZ)


def efficiencies(index, ka):
    """Extinction and scattering over pi a^2: the energy taken from the wave and the part sent on."""
    te, tm = _coefficients(np.array([ka]), index**2)
    weight = 2 / ka**2 * (2 * np.arange(1, len(te) + 1)[:, None] + 1)
    return -(weight * (te + tm).real).sum(), (weight * (np.abs(te) ** 2 + np.abs(tm) ** 2)).sum()


@pytest.mark.parametrize("index", [1.2, 1.55, 3.13])
@pytest.mark.parametrize("ka", [0.3, 5.0, 83.0])
def test_a_lossless_sphere_scatters_what_it_takes(index, ka):
    extinction, scattering = efficiencies(index, ka)
    assert_allclose(scattering, extinction, rtol=1e-9)


def test_a_lossy_sphere_absorbs():
    extinction, scattering = efficiencies(1.64 - 0.03j, 50.0)
    assert 0 < scattering < 0.9 * extinction


@pytest.mark.parametrize(
    ("index", "ka", "extinction", "scattering"),
    [
        # Bohren & Huffman, appendix A, sample output
        (1.55, 2 * np.pi * 0.525 / 0.6328, 3.10543, 3.10543),
        # Wiscombe, NCAR TN-140 (1979), test cases
        (1.5 - 1j, 100.0, 2.097502, 1.283697),
        (1.33 - 1e-5j, 1.0, 0.093952, 0.093923),
        (1.33 - 1e-5j, 100.0, 2.101321, 2.096594),
    ],
)
def test_published_efficiencies(index, ka, extinction, scattering):
    # half a unit of the last digit printed
    assert_allclose(
        efficiencies(index, ka), (extinction, scattering), rtol=0, atol=5.1e-6 * max(1, extinction / 3)
    )


def test_published_backscatter_of_a_dielectric_sphere():
    """Bohren & Huffman, appendix A: 2.92534."""
    backscatter = sphere_rcs_m2(1.0, frequency_of(2 * np.pi * 0.525 / 0.6328), 1.55**2)[0] / np.pi
    assert_allclose(backscatter, 2.92534, atol=5e-6)


@pytest.mark.parametrize(
    ("index", "ka"), [(1.5 - 1j, 10.0), (1.33, 100.0), (2 - 0.5j, 50.0), (1.22 - 0.02j, 83.0)]
)
def test_dielectric_cross_section_agrees_with_miepython(index, ka):
    """ka = 100 at 1.33 has narrow resonances: they show a recurrence that starts too near the turning point."""
    miepython = pytest.importorskip("miepython")
    backscatter = miepython.efficiencies_mx(index, ka)[2]
    # it sums ten orders fewer
    assert_allclose(sphere_rcs_m2(1.0, frequency_of(ka), index**2)[0] / np.pi, backscatter, rtol=1e-6)


def test_huge_permittivity_is_a_conductor():
    """Fresnel leaves 2 / |m| of the amplitude inside: 2e-2 at |eps| = 1e4, a tenth of that for a hundredfold."""
    conductor = sphere_echo(0.03, [0, 0, -0.4], ORIGIN, None, FREQUENCIES_HZ)
    errors = [
        np.abs(sphere_echo(0.03, [0, 0, -0.4], ORIGIN, None, FREQUENCIES_HZ, eps) / conductor - 1).max()
        for eps in (-1e4j, -1e6j)
    ]
    assert errors[0] < 3e-2
    assert errors[1] < 0.11 * errors[0]


def test_permittivity_one_is_no_sphere():
    conductor = sphere_echo(0.03, [0, 0, -0.4], ORIGIN, None, FREQUENCIES_HZ)
    air = sphere_echo(0.03, [0, 0, -0.4], ORIGIN, None, FREQUENCIES_HZ, 1.0)
    assert np.abs(air / conductor).max() < 1e-10


@pytest.mark.parametrize("permittivity", [6 - 3j, 3 - 1j, 2.7 - 0.5j])
@pytest.mark.parametrize("radius_m", [0.03, 0.04, 0.05])
def test_a_lossy_sphere_is_optics_times_fresnel(radius_m, permittivity):
    """No ray comes back from inside: the conductor's optics with Fresnel's coefficient in place of -1."""
    exact = sphere_echo(radius_m, [0, 0, -0.4], ORIGIN, None, FREQUENCIES_HZ, permittivity)[0]
    ratio = exact / (-fresnel_reflection(permittivity, 1.0).s * sphere_optics(radius_m, 0.4, FREQUENCIES_HZ))
    # measured 0.0013 dB and 0.50 degrees at 3 cm: the next term of the asymptotic series, 1 / (2 ka)
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 0.01
    assert np.abs(np.degrees(np.angle(ratio))).max() < 0.6


def test_a_dielectric_sphere_is_reciprocal():
    rng = np.random.default_rng(3)
    tx, rx = (np.column_stack([rng.uniform(-0.2, 0.2, (5, 2)), rng.uniform(0, 0.2, 5)]) for _ in "ab")
    forth = sphere_echo(0.05, [0.01, 0, -0.3], tx, rx, FREQUENCIES_HZ, 2.7 - 0.02j)
    assert_allclose(
        sphere_echo(0.05, [0.01, 0, -0.3], rx, tx, FREQUENCIES_HZ, 2.7 - 0.02j), forth, rtol=1e-11
    )
