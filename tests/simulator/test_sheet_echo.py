"""The own echo of a sheet: image law and slab, through other sheets, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.closed_forms import disc_near_axis, infinite_plane
from waveformer.simulator.errors import RadarError
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.permittivity import lookup_permittivity
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.sheet_echo import sheet_echo
from waveformer.simulator.slab import slab_reflection, slab_transmission
from waveformer.simulator.surroundings import Surroundings

CHIRP = Chirp(77.5001e9, 3.0009e9, 16)
F = CHIRP.frequencies_hz
ABS = np.array([lookup_permittivity("abs").at(f) for f in F])
WOOD = np.array([lookup_permittivity("wood").at(f) for f in F])
TOLERANCE = 1e-3


def sheet(z: float = -0.2, normal: tuple[float, float, float] = (0, 0, 1), name: str = "abs") -> Sheet:
    return Sheet((0.0, 0.0, z), normal, 0.003, name, echo=True)


def echo(one: Sheet, aperture: Aperture, **surroundings: object) -> np.ndarray:
    sheets = surroundings.pop("others", ())
    around = Surroundings(sheets=(one, *sheets), **surroundings)  # type: ignore[arg-type, misc]
    return sheet_echo(one, around, CHIRP, aperture, TOLERANCE).astype(complex)


def closeness(value: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs(value / truth - 1).max())


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1)])
def test_a_level_sheet_is_a_mirror_times_the_slab(normal: tuple[float, float, float]) -> None:
    h = echo(sheet(normal=normal), Aperture([[0, 0, 0], [0.3, -0.2, 0], [0, 0, 0.1]]))
    distance = np.array([0.2, 0.2, 0.3])[:, None]
    truth = infinite_plane(distance, F, 1.0) * slab_reflection(ABS, 0.003, 1.0, F).s
    # TOLERANCE of the interpolation, relative to the largest value in the band
    assert closeness(h, truth) < 2e-3


def test_a_thick_good_conductor_is_the_plane_of_the_closed_form() -> None:
    h = echo(Sheet((0, 0, -0.2), (0, 0, 1), 0.01, 1 - 1e7j, echo=True), Aperture([[0, 0, 0]]))
    assert closeness(h, infinite_plane(0.2, F)[None]) < 2e-3  # Gamma = -1 + 2 / sqrt(1e7)


def test_a_large_disc_has_the_same_echo() -> None:
    """Physical optics of a disc of 6 m at 0.2 m, without approximation.

    Its rim returns (d / a)^2 = 0.44 %, physical optics of a mirror is 1 / (k d) = 0.3 % off the image law, and the
    band's interpolation and the finite conductivity add 0.16 %.
    """
    h = echo(Sheet((0, 0, -0.2), (0, 0, 1), 0.01, 1 - 1e7j, echo=True), Aperture([[0, 0, 0]]))
    assert closeness(h, disc_near_axis(3.0, 0.2, F)[None]) < 0.009


@pytest.mark.parametrize("along", ["x", "y"])
def test_pairs_see_the_slab_at_their_angle(along: str) -> None:
    """E lies along y: across the plane of incidence for a pair along x, in it for a pair along y."""
    apart = 0.3
    step = np.array([apart, 0, 0]) if along == "x" else np.array([0, apart, 0])
    h = echo(sheet(), Aperture([-step / 2], [step / 2]))
    path = np.hypot(0.2, apart / 2)
    slab = slab_reflection(ABS, 0.003, 0.2 / path, F)
    truth = infinite_plane(path, F, 1.0) * (slab.s if along == "x" else slab.p)
    assert closeness(h, truth[None]) < 2e-3
    swapped = echo(sheet(), Aperture([step / 2], [-step / 2]))
    np.testing.assert_allclose(swapped, h, rtol=1e-6)


def test_a_slanted_sheet_is_as_far_as_its_normal_says() -> None:
    normal = np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    h = echo(sheet(normal=(0.3, -0.2, 1.0)), Aperture([[0.05, 0.02, 0.0]]))
    distance = float(np.dot([0.05, 0.02, 0.2], normal))
    truth = infinite_plane(distance, F, 1.0) * slab_reflection(ABS, 0.003, 1.0, F).s
    assert closeness(h, truth[None]) < 2e-3


def test_another_sheet_in_between_weakens_it_and_one_behind_does_not() -> None:
    aperture = Aperture([[0.0, 0.0, 0.0]])
    alone = echo(sheet(), aperture)
    behind = echo(sheet(), aperture, others=(sheet(-0.3, name="wood"),))
    np.testing.assert_allclose(behind, alone, rtol=2e-3)
    between = echo(sheet(), aperture, others=(sheet(-0.1, name="wood"),))
    through = slab_transmission(WOOD, 0.003, 1.0, F).s ** 2
    # spreading of the spherical wave in the wood adds d / R, 1.5 %, twice at most
    assert closeness(between / alone, through[None]) < 0.03


def test_the_antenna_weighs_it_twice() -> None:
    aperture, antenna = Aperture([[0.0, 0.0, 0.0]]), Antenna.isotropic(gain_dbi=7.0)
    ratio = echo(sheet(), aperture, antenna=antenna) / echo(sheet(), aperture)
    np.testing.assert_allclose(ratio, 10 ** (7.0 / 10), rtol=1e-5)


def test_a_sheet_of_permittivity_one_returns_nothing() -> None:
    h = echo(Sheet((0, 0, -0.2), (0, 0, 1), 0.003, 1.0, echo=True), Aperture([[0.0, 0.0, 0.0]]))
    assert np.abs(h).max() < 1e-12


def test_antennas_on_both_sides_are_refused() -> None:
    with pytest.raises(RadarError, match="on one side"):
        echo(sheet(-0.2), Aperture([[0, 0, 0]], [[0, 0, -0.3]]))
