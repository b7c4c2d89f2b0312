"""The BSDF plugins: their physics, their energy and what they refuse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.special import erf

from waveformer.simulator.bsdf import register_bsdfs
from waveformer.simulator.bsdf_lobe import rough_slope

FREQUENCY_HZ = 79e9
WAVENUMBER = 2 * np.pi * FREQUENCY_HZ / 299_792_458.0

CONDUCTOR = {"type": "radar_specular", "material": "pec"}
ROUGH = CONDUCTOR | {"roughness": 4e-4}
VERY_ROUGH = CONDUCTOR | {"roughness": 2e-3, "correlation_length": 2e-3}
PLASTIC = {"type": "radar_specular", "permittivity": 2.8, "loss": 0.03}
ROUGH_WOOD = {"type": "radar_specular", "material": "wood", "roughness": 3e-4}
SHELL = {"type": "radar_specular", "permittivity": 2.8, "loss": 0.03, "thickness": 1.5e-3}
WIDE = PLASTIC | {"lobe_width": 40.0}
SHEET = {"type": "radar_sheet", "permittivity": 2.0, "thickness": 2.3e-3, "echo": True}
ALL = [CONDUCTOR, ROUGH, VERY_ROUGH, PLASTIC, ROUGH_WOOD, SHELL, WIDE, SHEET]


@pytest.fixture(autouse=True)
def plugins(mitsuba_variant: str) -> None:
    register_bsdfs()


def load(description: dict[str, Any]) -> Any:
    import mitsuba as mi

    return mi.load_dict({"frequency": FREQUENCY_HZ, **description})


def context() -> Any:
    """Reflection only: what a sheet lets straight through has no density."""
    import mitsuba as mi

    ctx = mi.BSDFContext()
    ctx.type_mask = +mi.BSDFFlags.GlossyReflection
    return ctx


def direction(angle_deg: float, azimuth_deg: float = 0.0) -> np.ndarray:
    angle, azimuth = np.radians([angle_deg, azimuth_deg])
    return np.array(
        [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle) + 0 * azimuth]
    )


def evaluate(bsdf: Any, wi: np.ndarray, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """BRDF times cosine, and density, for directions wo (N, 3)."""
    import drjit as dr
    import mitsuba as mi

    si = dr.zeros(mi.SurfaceInteraction3f, len(wo))
    si.wi = mi.Vector3f(*wi.tolist())
    value, density = bsdf.eval_pdf(context(), si, mi.Vector3f(*np.float32(wo).T))
    return np.array(value[0], dtype=float), np.array(density, dtype=float)


def half_vector_rule(wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions wo and solid angles: half vectors on a logarithmic grid of slopes, fine at every lobe's scale."""
    edges = np.concatenate([[0], np.geomspace(1e-3, 1e3, 300)])
    theta = np.arctan(edges)
    middle, width = (theta[1:] + theta[:-1]) / 2, np.diff(theta)
    azimuth = (np.arange(128) + 0.5) * (2 * np.pi / 128)
    tilt, turn = (grid.ravel() for grid in np.meshgrid(middle, azimuth, indexing="ij"))
    half = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)
    along = half @ wi
    # reflection stretches the solid angle of the half vector by 4 (wi . h)
    solid_angle = 4 * along * np.repeat(np.sin(middle) * width, 128) * (2 * np.pi / 128)
    ahead = along > 0
    return (2 * along[:, None] * half - wi)[ahead], solid_angle[ahead]


def reflected_power(description: dict[str, Any], angle_deg: float) -> tuple[float, float]:
    """Integrals of BRDF times cosine and of the density over all directions."""
    wi = direction(angle_deg)
    wo, solid_angle = half_vector_rule(wi)
    value, density = evaluate(load(description), wi, wo)
    return float(value @ solid_angle), float(density @ solid_angle)


def fresnel_power(permittivity: complex, cosine: np.ndarray) -> np.ndarray:
    root = np.sqrt(permittivity - 1 + cosine**2)
    s, p = (cosine - root) / (cosine + root), (permittivity * cosine - root) / (permittivity * cosine + root)
    return (np.abs(s) ** 2 + np.abs(p) ** 2) / 2


@pytest.mark.parametrize("description", ALL, ids=lambda d: "-".join(map(str, d.values())))
def test_reflected_energy_is_never_above_one(description: dict[str, Any]) -> None:
    for angle_deg in (0.0, 25.0, 50.0, 70.0, 80.0, 86.0, 89.0):
        power, chance = reflected_power(description, angle_deg)
        # the rule's own error, which shows in the density's integral where no direction falls below the surface
        assert 0 <= power <= 1.002, angle_deg
        assert chance <= 1.002, angle_deg


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 60.0])
def test_a_smooth_surface_reflects_what_fresnel_says(angle_deg: float) -> None:
    narrow = PLASTIC | {"lobe_width": 1.0}
    expected = fresnel_power(2.8 - 0.03j, np.cos(np.radians(angle_deg)))
    # 0.2 % for the rule; Smith's shadowing costs nothing at slopes of 0.01
    assert reflected_power(narrow, angle_deg)[0] == pytest.approx(expected, rel=2e-3)
    assert reflected_power(CONDUCTOR, angle_deg)[0] == pytest.approx(1.0, rel=2e-3)


def test_a_lossless_slab_keeps_all_power() -> None:
    lossless = SHEET | {"lobe_width": 1.0}
    for angle_deg in (0.0, 45.0):
        through = transmittance(load(lossless), angle_deg)
        assert reflected_power(lossless, angle_deg)[0] + through == pytest.approx(1.0, abs=2e-3)


def test_the_rough_lobe_takes_what_the_coherent_one_lost() -> None:
    # Ament at normal incidence: the mirror direction keeps exp(-(2 k sigma)^2), the rest is spread
    kept = math.exp(-((2 * WAVENUMBER * 4e-4) ** 2))
    assert 0.1 < kept < 0.3
    wi = direction(0.0)
    smooth, _ = evaluate(load(CONDUCTOR), wi, wi[None])
    rough, _ = evaluate(load(ROUGH), wi, wi[None])
    slope = math.tan(math.radians(2.5))
    spread = math.hypot(slope, rough_slope(WAVENUMBER, 4e-4, 4e-3))
    assert rough / smooth == pytest.approx(kept + (1 - kept) * (slope / spread) ** 2, rel=1e-5)
    # Not all of it: towards grazing the surface is smoother, and the smaller weight of both directions is taken,
    # which is what keeps the sum below 1. Measured 0.933.
    assert 0.9 < reflected_power(ROUGH, 0.0)[0] < 1.0


def test_width_of_the_rough_lobe_between_its_limits() -> None:
    wavenumber, length_m = 1650.0, 3e-3
    assert rough_slope(wavenumber, 1e-6, length_m) == pytest.approx(1 / (wavenumber * length_m), rel=1e-4)
    assert rough_slope(wavenumber, 3e-3, length_m) == pytest.approx(2 * 3e-3 / length_m, rel=1e-4)


def test_eval_equals_a_plain_float64_microfacet_model(rng: np.random.Generator) -> None:
    sigma_m, permittivity = 3e-4, 2.8 - 0.03j
    slopes = [math.tan(math.radians(10.0))]
    slopes.append(math.hypot(slopes[0], rough_slope(WAVENUMBER, sigma_m, 2e-3)))
    bsdf = load(PLASTIC | {"lobe_width": 20.0, "roughness": sigma_m, "correlation_length": 2e-3})

    def density(cosine: np.ndarray, slope: float) -> np.ndarray:
        return np.exp((1 - 1 / cosine**2) / slope**2) / (np.pi * slope**2 * cosine**4)

    def shadowing(cosine: float, slope: float) -> float:
        a = cosine / (slope * math.sqrt(1 - cosine**2))
        return float(2 / (1 + erf(a) + math.exp(-a * a) / (a * math.sqrt(math.pi))))

    for angle_in, angle_out, azimuth in rng.uniform([5, 5, 120], [75, 75, 240], (20, 3)):
        wi, wo = direction(angle_in), direction(angle_out, azimuth)
        half = (wi + wo) / np.linalg.norm(wi + wo)
        kept = [np.exp(-((2 * WAVENUMBER * sigma_m * cosine) ** 2)) for cosine in sorted((wi[2], wo[2]))]
        total = sum(
            weight * density(half[2], slope) * shadowing(wi[2], slope) * shadowing(wo[2], slope)
            for weight, slope in zip((kept[1], 1 - kept[0]), slopes, strict=True)
        )
        expected = fresnel_power(permittivity, half @ wi) * total / (4 * wi[2])
        value, _ = evaluate(bsdf, wi, wo[None])
        # Mitsuba's rational fit of Smith's shadowing is good to 0.4 % a direction
        assert value == pytest.approx(expected, rel=1e-2, abs=1e-7)


@pytest.mark.parametrize("description", [ROUGH_WOOD, SHELL], ids=["rough", "shell"])
def test_reciprocity_and_equal_sides(description: dict[str, Any]) -> None:
    bsdf, one, other = load(description), direction(30.0), direction(38.0, 175.0)
    forth, _ = evaluate(bsdf, one, other[None])
    back, _ = evaluate(bsdf, other, one[None])
    below, _ = evaluate(bsdf, -one, -other[None])
    assert forth > 0
    assert back / one[2] == pytest.approx(forth / other[2], rel=1e-4)
    assert below == pytest.approx(forth, rel=1e-5)
    through, _ = evaluate(bsdf, one, -other[None])
    assert through == 0


@pytest.mark.parametrize(
    "description", [CONDUCTOR, ROUGH_WOOD, VERY_ROUGH, SHEET], ids=lambda d: str(d)[9:50]
)
def test_samples_carry_the_reflected_power_and_never_gain(
    description: dict[str, Any], rng: np.random.Generator
) -> None:
    for angle_deg in (0.0, 60.0, 85.0):
        _, weight = draw(load(description), angle_deg, context(), rng)
        assert weight.max() <= 1 + 1e-4
        # 2^18 samples: standard error below 0.1 %
        assert weight.mean() == pytest.approx(reflected_power(description, angle_deg)[0], abs=5e-3)


def draw(bsdf: Any, angle_deg: float, ctx: Any, rng: np.random.Generator) -> tuple[Any, np.ndarray]:
    import drjit as dr
    import mitsuba as mi

    count = 1 << 18
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(*direction(angle_deg).tolist())
    one, two, three = (mi.Float(numbers) for numbers in rng.random((3, count), dtype=np.float32))
    sample, weight = bsdf.sample(ctx, si, one, mi.Point2f(two, three))
    return sample, np.array(weight[0], dtype=float)


def transmittance(bsdf: Any, angle_deg: float) -> float:
    import drjit as dr
    import mitsuba as mi

    si = dr.zeros(mi.SurfaceInteraction3f, 1)
    si.wi = mi.Vector3f(*direction(angle_deg).tolist())
    return float(bsdf.eval_null_transmission(si)[0][0])


@pytest.mark.parametrize("echo", [True, False])
def test_a_sheet_lets_its_transmission_through(echo: bool, rng: np.random.Generator) -> None:
    import mitsuba as mi

    sheet = load(SHEET | {"echo": echo, "loss": 0.05})
    sample, weight = draw(sheet, 40.0, mi.BSDFContext(), rng)
    passes = np.array(sample.sampled_type) == +mi.BSDFFlags.Null
    assert np.abs(np.array(sample.wo)[:, passes].T + direction(40.0)).max() < 1e-6
    through = transmittance(sheet, 40.0)
    assert 0.5 < through < 0.95
    # both estimates from 2^18 samples
    assert weight[passes].sum() / len(weight) == pytest.approx(through, abs=5e-3)
    assert weight.mean() - through == pytest.approx(
        reflected_power(SHEET | {"loss": 0.05}, 40.0)[0] if echo else 0.0, abs=5e-3
    )
    if not echo:
        assert passes.all()


def test_a_render_sees_the_light_behind_a_sheet() -> None:
    import mitsuba as mi

    sheet = {"type": "radar_sheet", "material": "cardboard", "thickness": 4e-3}
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 4},
            "sky": {"type": "constant"},
            "sheet": {
                "type": "rectangle",
                "bsdf": sheet,
            },
            "sensor": {
                "type": "radiancemeter",
                "origin": [0.1, 0, 3],
                "direction": [0, 0, -1],
                "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}},
            },
        }
    )
    expected = transmittance(mi.load_dict(sheet), 0.0)
    assert np.array(mi.render(scene, spp=16))[0, 0, 0] == pytest.approx(expected, rel=1e-4)


def test_registering_twice_is_harmless() -> None:
    import mitsuba as mi

    register_bsdfs()
    assert "pec" in str(mi.load_dict(CONDUCTOR))


@pytest.mark.parametrize("plugin", ["radar_specular", "radar_sheet"])
def test_an_unknown_parameter_is_refused_by_name(plugin: str) -> None:
    import mitsuba as mi

    with pytest.raises(RuntimeError, match=f"{plugin} has no parameter 'rougness'; known: .*thickness"):
        mi.load_dict({"type": plugin, "material": "wood", "thickness": 1e-3, "rougness": 1e-4})
    with pytest.raises(RuntimeError, match=f"{plugin} has no parameter 'rougness'; known: .*thickness"):
        mi.load_string(
            f'<bsdf version="3.0.0" type="{plugin}"><string name="material" value="wood"/>'
            '<float name="thickness" value="0.001"/><float name="rougness" value="0.0001"/></bsdf>'
        )
