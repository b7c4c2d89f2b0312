"""At how many frequencies W must be known, when it is a constant, and what matter a wall needs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.radar import Chirp
from waveformer.simulator.response_plan import (
    ResponsePlan,
    constant_response,
    plan_response,
    wall_reflection,
    wall_transmission,
)
from waveformer.simulator.slab import (
    fresnel_reflection,
    refraction_factor,
    slab_reflection,
    slab_transmission,
)
from waveformer.simulator.surroundings import Surroundings

CHIRP = Chirp(77.5001e9, 3.0009e9, 32)
BOUNDS = np.array([[-0.05, -0.05, -0.4], [0.05, 0.05, -0.3]])
ANTENNAS = np.array([[-0.1, -0.1, 0.0], [0.1, 0.1, 0.0]])
PEC = Material.pec()


def plan(
    material: Material = PEC, tolerance: float = 1e-3, crossings: Any = "none", **around: Any
) -> ResponsePlan:
    return plan_response(material, Surroundings(**around), crossings, CHIRP, tolerance, BOUNDS, ANTENNAS)


def sheet(thickness_m: float = 0.003, permittivity: complex | str = "abs") -> Sheet:
    return Sheet((0, 0, -0.1), (0, 0, 1), thickness_m, permittivity)


def test_a_smooth_conductor_in_the_open_is_a_constant() -> None:
    assert constant_response(PEC, Surroundings()) == -1.0
    gain = Antenna.isotropic(gain_dbi=6.0)
    assert constant_response(PEC, Surroundings(antenna=gain)) == pytest.approx(-(10 ** (6.0 / 10)))


@pytest.mark.parametrize(
    ("material", "around"),
    [
        (Material.pec(roughness_m=1e-4), {}),
        (Material.named("metal"), {}),
        (PEC, {"sheets": sheet()}),
        (PEC, {"box": Box((-0.1, -0.1, -0.5), (0.1, 0.1, -0.2), 0.003, "foam")}),
        (PEC, {"antenna": Antenna.from_preset("iwr1443")}),
    ],
)
def test_everything_else_is_not(material: Material, around: dict[str, Any]) -> None:
    assert constant_response(material, Surroundings(**around)) is None


def test_what_does_not_depend_on_frequency_needs_one() -> None:
    assert len(plan(Material.dielectric(3.0 - 0.1j)).frequencies_hz) == 1
    assert len(plan(antenna=Antenna.from_preset("iwr1443")).frequencies_hz) == 1


def test_the_weights_are_exact_at_the_nodes_and_along_the_spectrum_of_one_angle() -> None:
    found = plan(sheets=sheet())
    assert found.to_samples.shape == (len(found.frequencies_hz), 32)
    eps = complex(2.7 - 0.022j)
    angles = np.cos(np.linspace(0.0, 0.6, 400))
    spectra = [
        slab_transmission(eps, 0.003, angles[:, None], f).s ** 2
        for f in (found.frequencies_hz, CHIRP.frequencies_hz)
    ]
    error = np.abs(spectra[0] @ found.to_samples - spectra[1]).max(axis=1)
    # one of the angles is the one of the spectrum; the steps between are 0.09 degrees
    assert error.min() < 3e-6
    assert error.max() < 1e-3


def test_more_delay_or_a_smaller_tolerance_needs_more() -> None:
    counts = [len(plan(sheets=sheet(d)).frequencies_hz) for d in (0.001, 0.005, 0.02)]
    assert counts == sorted(counts) and counts[0] < counts[-1]
    assert len(plan(sheets=sheet(), tolerance=1e-5).frequencies_hz) > len(plan(sheets=sheet()).frequencies_hz)
    assert len(plan(sheets=[sheet(), sheet()]).frequencies_hz) >= len(plan(sheets=sheet()).frequencies_hz)


@pytest.mark.parametrize("thickness_m", [0.001, 0.005, 0.02])
def test_the_tolerance_is_kept(thickness_m: float) -> None:
    """At normal incidence, against the slab itself."""
    found = plan(sheets=sheet(thickness_m))
    eps = complex(2.7 - 0.022j)
    at_nodes = -(slab_transmission(eps, thickness_m, 1.0, found.frequencies_hz).s ** 2)
    truth = -(slab_transmission(eps, thickness_m, 1.0, CHIRP.frequencies_hz).s ** 2)
    assert np.abs(at_nodes @ found.to_samples - truth).max() < 1e-3


def test_phase_turns_faster_behind_thicker_walls_and_over_wider_pieces() -> None:
    slopes = [plan(sheets=sheet(d)).phase_per_radian for d in (0.002, 0.02)]
    assert 0 < slopes[0] < slopes[1]
    surroundings = Surroundings()
    flat = plan_response(
        PEC, surroundings, "none", CHIRP, 1e-3, BOUNDS, ANTENNAS, np.array([4e-3, 4e-3, 0.0])
    )
    # two ways, half of the edges' root sum of squares each: k sqrt(32) mm
    assert flat.phase_per_radian > 2 * np.pi / CHIRP.wavelengths_m[0] * np.hypot(4e-3, 4e-3) * 0.9


def test_a_wall_of_the_box_counts_only_where_it_is_crossed() -> None:
    box = Box((-0.1, -0.1, -0.5), (0.1, 0.1, -0.2), 0.01, "abs")
    counts = {c: len(plan(crossings=c, box=box).frequencies_hz) for c in ("none", "leaving", "any")}
    assert counts["none"] == 1 < counts["leaving"] <= counts["any"]


def test_reflection_follows_the_kind_of_matter() -> None:
    cosine = np.array([1.0, 0.7])
    np.testing.assert_array_equal(wall_reflection(PEC, cosine, 79e9).p, [-1.0, -1.0])
    thick, thin = Material.dielectric(2.7 - 0.02j), Material.dielectric(2.7 - 0.02j, 0.003)
    np.testing.assert_allclose(wall_reflection(thick, cosine, 79e9), fresnel_reflection(2.7 - 0.02j, cosine))
    expected = slab_reflection(2.7 - 0.02j, 0.003, cosine, 79e9)
    np.testing.assert_allclose(wall_reflection(thin, cosine, 79e9), expected)


def test_transmission_is_that_of_a_plane_wave_or_of_a_point_source() -> None:
    wall, cosine = Material.dielectric(2.7 - 0.02j, 0.003), np.array([1.0, 0.7])
    plane = slab_transmission(2.7 - 0.02j, 0.003, cosine, 79e9)
    np.testing.assert_allclose(wall_transmission(wall, cosine, None, 79e9), plane)
    distance = np.array([0.3, 0.5])
    bent = refraction_factor(2.7 - 0.02j, 0.003, cosine, distance, 79e9)
    np.testing.assert_allclose(wall_transmission(wall, cosine, distance, 79e9).p, plane.p * bent)


@pytest.mark.parametrize("wall", [PEC, Material.dielectric(2.7)])
def test_a_wall_without_thickness_lets_nothing_through(wall: Material) -> None:
    with pytest.raises(RadarError, match="needs a permittivity and a thickness"):
        wall_transmission(wall, np.array([1.0]), None, 79e9)


def test_neighbours_make_the_difference_of_the_response_right_to_its_own_size() -> None:
    from waveformer.simulator.matter_parameters import changed
    from waveformer.simulator.reference_response import pair_response
    from waveformer.simulator.response_plan import WallChange

    around = Surroundings(sheets=(sheet(0.003, 6 - 0.1j),))
    change = WallChange(0, "thickness")
    _, near, _ = changed(PEC, around, change)
    points = np.array([[x, 0.01, -0.35] for x in np.linspace(-0.05, 0.05, 11)])
    normal, antenna = np.array([0.0, 0.1, 0.995]), np.array([-0.05, 0.08, 0.0])
    errors = []
    for neighbours in ((), ((PEC, near),)):
        made = plan_response(PEC, around, "none", CHIRP, 1e-2, BOUNDS, ANTENNAS, neighbours=neighbours)

        def difference(frequencies_hz: np.ndarray, made: ResponsePlan = made) -> np.ndarray:
            ends = [
                [pair_response(scene, float(f), points, normal, antenna, antenna) for f in frequencies_hz]
                for scene in (made, replace(made, surroundings=near))
            ]
            return np.array(ends[1]) - np.array(ends[0])

        exact = difference(CHIRP.frequencies_hz)
        between = made.to_samples.T @ difference(made.frequencies_hz)
        errors.append(np.abs(between - exact).max() / np.abs(exact).max())
    # the tolerance given to plan_response
    assert errors[1] < 1e-2 < errors[0]


def test_no_neighbours_change_nothing() -> None:
    around = Surroundings(sheets=(sheet(0.006),))
    plans = [
        plan_response(PEC, around, "none", CHIRP, 1e-3, BOUNDS, ANTENNAS, neighbours=neighbours)
        for neighbours in ((), [(PEC, around)])
    ]
    assert (plans[0].frequencies_hz == plans[1].frequencies_hz).all()
    assert (plans[0].to_samples == plans[1].to_samples).all()
