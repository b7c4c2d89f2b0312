"""Mean echo power by an ordinary render: closed forms, and the coherent sum where interference averages out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from waveformer.simulator import Aperture, Chirp, Material, Target, load_mesh, primitives, simulate
from waveformer.simulator.bsdf import register_bsdfs
from waveformer.simulator.closed_forms import sphere_optics
from waveformer.simulator.errors import RadarError
from waveformer.simulator.incoherent import incoherent_scene, mean_echo_power

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

FREQUENCY_HZ = 79e9


def decibels(ratio: float) -> float:
    return 10 * math.log10(ratio)


def ball(radius_m: float, center_m: tuple[float, float, float], **bsdf: Any) -> Any:
    register_bsdfs()
    import mitsuba as mi

    plugin = {"type": "radar_specular", "frequency": FREQUENCY_HZ, **bsdf}
    sphere = {"type": "sphere", "center": list(center_m), "radius": radius_m, "bsdf": plugin}
    return mi.load_dict({"type": "scene", "ball": sphere})


@pytest.mark.parametrize("radius_m", [0.02, 0.05, 0.1])
def test_a_conducting_sphere_returns_pi_a_squared(radius_m: float) -> None:
    center_m, position_m = (0.02, -0.01, -0.4 - radius_m), (0.01, 0.03, 0.0)
    power = mean_echo_power(ball(radius_m, center_m, material="pec"), position_m, FREQUENCY_HZ)
    expected = abs(sphere_optics(radius_m, math.dist(center_m, position_m), FREQUENCY_HZ)) ** 2
    # asked 0.5 dB; the lobe of 5 degrees adds tan^2(2.5 degrees) / 2 = 0.004 dB, rays and pixels as much again
    assert decibels(power / expected) == pytest.approx(0.0, abs=0.02)


def test_the_far_field_is_the_radar_equation() -> None:
    radius_m, range_m, wavelength_m = 0.05, 50.0, 299_792_458.0 / FREQUENCY_HZ
    power = mean_echo_power(ball(radius_m, (0, range_m, 0), material="pec"), (0, 0, 0), FREQUENCY_HZ)
    cross_section_m2 = power * (4 * math.pi) ** 3 * range_m**4 / wavelength_m**2
    # as above, and the foot of the echo is 5 cm nearer than the centre: 0.01 dB
    assert decibels(cross_section_m2 / (math.pi * radius_m**2)) == pytest.approx(0.0, abs=0.03)


def test_a_dielectric_sphere_returns_fresnel_times_the_conductor() -> None:
    where = ((0.0, 0.0, -0.45), (0.0, 0.0, 0.0))
    conductor = mean_echo_power(ball(0.05, where[0], material="pec"), where[1], FREQUENCY_HZ)
    dielectric = mean_echo_power(ball(0.05, where[0], permittivity=3.0, loss=0.1), where[1], FREQUENCY_HZ)
    index = np.sqrt(3.0 - 0.1j)
    fresnel = abs((index - 1) / (index + 1)) ** 2
    # only the microfacets that look at the radar count: same rays, normal incidence, float32 alone
    assert decibels(dielectric / conductor / fresnel) == pytest.approx(0.0, abs=0.001)


@pytest.mark.parametrize("bsdf", [{"roughness": 5e-4}, {"lobe_width": 30.0}], ids=["rough", "wide"])
def test_a_wider_lobe_moves_power_about_but_not_its_mean(bsdf: dict[str, Any]) -> None:
    power = mean_echo_power(
        ball(0.05, (0, 0, -5.0), material="pec", **bsdf), (0, 0, 0), FREQUENCY_HZ, pixels=256
    )
    expected = abs(sphere_optics(0.05, 5.0, FREQUENCY_HZ)) ** 2
    # at most slope^2 / 2 of the lobe: 0.15 dB at 30 degrees, 0.14 dB at this roughness
    assert 0.0 < decibels(power / expected) < 0.17


def test_targets_are_as_good_as_a_scene() -> None:
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.01, -0.4]
    target = Target(primitives.sphere(0.03, 1.5e-3), Material.dielectric(2.7 - 0.05j), pose)
    power = mean_echo_power(target, (0, 0, 0), FREQUENCY_HZ)
    expected = mean_echo_power(
        ball(0.03, (0, 0.01, -0.4), permittivity=2.7, loss=0.05), (0, 0, 0), FREQUENCY_HZ
    )
    # facets of 1.5 mm on a ball of 3 cm are 3 degrees apart, as wide as the lobe's tilt
    assert decibels(power / expected) == pytest.approx(0.0, abs=0.2)


def test_a_ball_behind_another_is_not_heard() -> None:
    pair = [
        Target(primitives.sphere(radius_m, 3e-3), pose=at(z_m))
        for radius_m, z_m in ((0.04, -0.3), (0.02, -0.5))
    ]
    both = mean_echo_power(pair, (0, 0, 0), FREQUENCY_HZ)
    front = mean_echo_power(pair[0], (0, 0, 0), FREQUENCY_HZ)
    behind = mean_echo_power(pair[1], (0, 0, 0), FREQUENCY_HZ)
    assert behind > 0.01 * front
    # the two renders frame the scene differently
    assert both == pytest.approx(front, rel=5e-3)


def at(z_m: float) -> np.ndarray:
    pose = np.eye(4)
    pose[2, 3] = z_m
    return pose


def test_a_radar_inside_the_scene_is_refused() -> None:
    with pytest.raises(RadarError, match="stands in or too near the scene"):
        mean_echo_power(ball(0.05, (0, 0, 0), material="pec"), (0.0, 0.0, 0.04), FREQUENCY_HZ)


@pytest.mark.slow
@pytest.mark.parametrize("radius_m", [0.02, 0.05, 0.1])
@pytest.mark.parametrize(
    "material", [Material.pec(), Material.dielectric(2.8 - 0.03j)], ids=["conductor", "dielectric"]
)
def test_spheres_agree_with_the_coherent_sum(radius_m: float, material: Material) -> None:
    chirp = Chirp(77e9, 4e9, 64)
    aperture = Aperture.planar_grid(3, 3, 0.02)
    target = Target(primitives.sphere(radius_m), material, at(-0.4 - radius_m))
    coherent = (np.abs(simulate(target, chirp, aperture).h) ** 2).mean()
    scene = incoherent_scene(target, chirp.center_hz)
    incoherent = np.mean([mean_echo_power(scene, v, chirp.center_hz) for v in aperture.tx_m])
    # asked 0.5 dB
    assert decibels(coherent / incoherent) == pytest.approx(0.0, abs=0.5)


@pytest.mark.slow
def test_a_mug_in_500_random_poses_agrees_with_the_coherent_sum() -> None:
    """Some minutes. Four positions a pose: flashes of the flat bottom are rare, and the mean hangs on them."""
    chirp = Chirp(77e9, 4e9, 32)
    aperture = Aperture.planar_grid(2, 2, 0.1)
    shape = primitives.mug(4e-3)
    shape.apply_translation(-shape.bounds.mean(axis=0))
    mesh = load_mesh(shape)
    # a lobe narrower than the near field's own flash of 3 degrees, so that both sums flash in the same poses
    scene = incoherent_scene(mesh, chirp.center_hz, lobe_width_deg=2.0)
    coherent, incoherent = [], []
    for turn in Rotation.random(500, random_state=0).as_matrix():
        pose = at(-0.8)
        pose[:3, :3] = turn
        coherent.append((np.abs(simulate(Target(mesh, pose=pose), chirp, aperture).h) ** 2).mean())
        # turning the radar about the mug spares a scene a pose
        for position_m in (aperture.tx_m - pose[:3, 3]) @ turn:
            incoherent.append(mean_echo_power(scene, position_m, chirp.center_hz, pixels=256))
    # asked 1 dB; resampling the poses moves the ratio by 0.25 dB
    assert decibels(np.mean(coherent) / np.mean(incoherent)) == pytest.approx(0.0, abs=1.0)
