"""Validation of materials: dielectric spheres, thin walls, named materials and rough surfaces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waveformer.simulator import primitives
from waveformer.simulator.closed_forms import polygon_near
from waveformer.simulator.materials import Material
from waveformer.simulator.permittivity import PERMITTIVITIES, lookup_permittivity
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture
from waveformer.simulator.slab import fresnel_reflection, slab_reflection
from waveformer.simulator.sphere_series import sphere_echo
from waveformer.simulator.target import Target
from waveformer.simulator.validation_curved import sphere_edge_m
from waveformer.simulator.validation_result import (
    MITO_BAND,
    CheckResult,
    FloatArray,
    Trial,
    level_db,
    phase_deg,
    placed,
    worst,
)

_DISTANCE_M = 0.4
_SIDE_M = 0.03
_OVERHEAD = Aperture(np.zeros((1, 3)))


def lossy_sphere(trial: Trial) -> Iterator[CheckResult]:
    """Dielectric spheres whose far side sends nothing back, against the exact series."""
    cases = [(0.03, 6 - 3j)] if trial.quick else [(0.03, 6 - 3j), (0.05, 6 - 3j), (0.05, 3 - 0.5j)]
    for radius, permittivity in cases:
        rng, count = trial.rng(f"lossy sphere {radius}"), trial.pick(8, 6, 4)
        center = np.array([0.0, 0.0, -_DISTANCE_M])
        antennas = np.column_stack([rng.uniform(-0.08, 0.08, (count, 2)), np.zeros(count)])
        material = Material.dielectric(permittivity)
        target = Target(primitives.sphere(radius, sphere_edge_m(radius)), material, placed(center))
        h = trial.simulate(target, MITO_BAND, Aperture(antennas))
        truth = sphere_echo(radius, center, antennas, None, MITO_BAND.frequencies_hz, permittivity)
        value = f"{permittivity.real:g}-{-permittivity.imag:g}j"
        yield CheckResult(
            f"sphere a = {100 * radius:g} cm of permittivity {value}, centre at 0.4 m",
            f"worst level error, {count} positions", worst(level_db(h / truth)), 0.3, "dB",
            "exact dyadic series of the dielectric sphere",
            "Fresnel at the tangent plane leaves out terms of 1 / (k a), as physical optics does", trial.mode,
            detail={"worst_deg": worst(phase_deg(h / truth))},
        )  # fmt: skip


def thin_wall(trial: Trial) -> Iterator[CheckResult]:
    """A plate with a thin wall: reflection of the slab times the echo of its outline."""
    walls = [("abs", 2e-3), ("cardboard", 5e-3)]
    walls = walls[:1] if trial.quick else [*walls, ("abs", 3e-3), ("wood", 5e-3)]
    rng, count = trial.rng("thin wall"), trial.pick(8, 6, 4)
    reach = 0.4 * _SIDE_M
    antennas = np.column_stack([rng.uniform(-reach, reach, (count, 2)), np.zeros(count)])
    f = MITO_BAND.frequencies_hz
    outline = polygon_near(_corners(), antennas, f)
    errors = {}
    for name, thickness in walls:
        h = trial.simulate(_plate(Material.named(name, thickness)), MITO_BAND, Aperture(antennas))
        slab = np.array([slab_reflection(lookup_permittivity(name).at(g), thickness, 1.0, g).s for g in f])
        errors[f"{name} {1e3 * thickness:g} mm"] = worst(level_db(h / (-slab * outline)))
    yield CheckResult(
        f"plate {100 * _SIDE_M:g} cm at 0.4 m with a thin wall of {', '.join(errors)}",
        f"worst level error, {count} positions", max(errors.values()), 0.1, "dB",
        "reflection of the slab at normal incidence x physical optics of the outline as an edge integral",
        "the plate's edge is seen at 4 deg, where a slab near its minimum reflects 0.05 dB more or less", trial.mode,
        detail=errors,
    )  # fmt: skip


def named_materials(trial: Trial) -> Iterator[CheckResult]:
    """Every named material over a conductor, both at normal incidence."""
    bare = trial.simulate(_plate(Material.pec()), MITO_BAND, _OVERHEAD)
    errors = {}
    for name, permittivity in PERMITTIVITIES.items():
        h = trial.simulate(_plate(Material.named(name)), MITO_BAND, _OVERHEAD)
        index = np.sqrt([permittivity.at(f) for f in MITO_BAND.frequencies_hz])
        errors[name] = worst(level_db(h / bare / ((index - 1) / (index + 1))))
    yield CheckResult(
        f"plate {100 * _SIDE_M:g} cm at 0.4 m of each named material: {', '.join(errors)}",
        "worst error of its level over a conductor's", max(errors.values()), 0.05, "dB",
        "Fresnel at normal incidence, |(n - 1) / (n + 1)|, from the cited permittivity",
        "the same sum on both sides: rounding, and the angles of 2 deg that the plate spans", trial.mode,
        detail=errors,
    )  # fmt: skip


def oblique_reflection(trial: Trial) -> Iterator[CheckResult]:
    """A chip too small for its shape to matter, tilted: Fresnel at the local angle in both polarisations."""
    chip, permittivity = primitives.plate(1e-3, 1e-3), lookup_permittivity("abs")
    f = MITO_BAND.frequencies_hz
    errors = {}
    for thickness in (None, 3e-3):
        for degrees in (30, 45) if trial.quick else (15, 30, 45):
            angle = np.radians(degrees)
            turn = np.array(
                [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
            )
            pose = placed((0, 0, -_DISTANCE_M), turn)
            bare = trial.simulate(Target(chip, pose=pose), MITO_BAND, _OVERHEAD)
            for name, field in (("s", (0.0, 1.0, 0.0)), ("p", (1.0, 0.0, 0.0))):
                target = Target(chip, Material.named("abs", thickness), pose)
                h = trial.simulate(target, MITO_BAND, _OVERHEAD, polarization=field)
                gamma = np.array(
                    [_reflection(permittivity.at(g), thickness, np.cos(angle), g, name) for g in f]
                )
                wall = "half space" if thickness is None else "wall"
                errors[f"{wall} {degrees} deg {name}"] = worst(level_db(h / bare / -gamma))
    yield CheckResult(
        "chip 1 mm of abs, half space and 3 mm wall, tilted to 45 deg", "worst level error, s and p",
        max(errors.values()), 0.05, "dB", "Fresnel's half space and slab at the angle of incidence",
        "as at normal incidence; the chip spans 0.1 deg", trial.mode, detail=errors,
    )  # fmt: skip


def rough_surface(trial: Trial) -> Iterator[CheckResult]:
    """A rough conductor over a smooth one: what is left in the mirror direction."""
    bare = trial.simulate(_plate(Material.pec()), MITO_BAND, _OVERHEAD)
    k = 2 * np.pi * MITO_BAND.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    sigmas = (2e-4, 5e-4) if trial.quick else (1e-4, 2e-4, 3e-4, 5e-4)
    errors = {}
    for sigma in sigmas:
        h = trial.simulate(_plate(Material.pec(roughness_m=sigma)), MITO_BAND, _OVERHEAD)
        law = np.exp(-((2 * k * sigma) ** 2))
        errors[f"{1e3 * sigma:g} mm"] = worst(level_db(h / bare) - 10 * np.log10(law))
    yield CheckResult(
        f"rough conducting plate {100 * _SIDE_M:g} cm at 0.4 m, rms height {', '.join(errors)}",
        "worst error of its level over a smooth one", max(errors.values()), 0.2, "dB",
        "Ament 1953: exp(-(2 k sigma)^2) in power", "12 dB of loss at 0.5 mm; the plate spans 2 deg", trial.mode,
        detail=errors,
    )  # fmt: skip


def _plate(material: Material) -> Target:
    return Target(primitives.plate(_SIDE_M, _SIDE_M, 2e-3), material, placed((0, 0, -_DISTANCE_M)))


def _corners() -> FloatArray:
    x = _SIDE_M / 2
    return np.array(
        [[-x, -x, -_DISTANCE_M], [x, -x, -_DISTANCE_M], [x, x, -_DISTANCE_M], [-x, x, -_DISTANCE_M]]
    )


def _reflection(
    permittivity: complex, thickness_m: float | None, cosine: float, frequency_hz: float, polarization: str
) -> complex:
    if thickness_m is None:
        amplitudes = fresnel_reflection(permittivity, cosine)
    else:
        amplitudes = slab_reflection(permittivity, thickness_m, cosine, frequency_hz)
    return complex(amplitudes.s if polarization == "s" else amplitudes.p)
