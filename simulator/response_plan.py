"""How the factor W of a target varies over band and angle, and so where the kernels must evaluate it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.interpolation import chebyshev_points, lagrange_weights
from waveformer.simulator.materials import Material
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp
from waveformer.simulator.slab import (
    Amplitudes,
    coherent_loss,
    fresnel_reflection,
    refraction_factor,
    slab_reflection,
    slab_transmission,
)
from waveformer.simulator.surroundings import Surroundings

# Which walls of the box a way crosses: none, the one by which it leaves, or any that it meets.
Crossings = Literal["none", "leaving", "any"]

_MAX_FREQUENCIES = 24
_BAND_PROBES = 49
# Angles of incidence on which the smoothness of W is judged.
_PROBE_DEG = np.arange(0.0, 75.1, 2.5)


@dataclass(frozen=True, eq=False)
class ResponsePlan:
    """W of one target: what it consists of and at which frequencies it is evaluated.

    Between the frequencies W is interpolated: W(f) = sum_m to_samples[m] W(f_m).

    Attributes:
        material: of the target.
        surroundings: antennas and occluders.
        crossings: walls of the box that the ways of this target cross.
        frequencies_hz: shape (M,).
        to_samples: from them to the samples of the chirp, shape (M, T).
        phase_per_radian: largest change of the phase of W with the angle of a way.
        facet_m: edges of flat rectangular samples along x, y and z, whose form factor W includes, shape (3,); None
            for samples that are small.
    """

    material: Material
    surroundings: Surroundings
    crossings: Crossings
    frequencies_hz: NDArray[np.float64]
    to_samples: NDArray[np.float64]
    phase_per_radian: float
    facet_m: NDArray[np.float64] | None = None


def constant_response(material: Material, surroundings: Surroundings) -> complex | None:
    """W if it is the same for every pair and frequency, else None."""
    if not material.is_conductor or material.roughness_m > 0 or surroundings.occludes:
        return None
    if not surroundings.antenna.is_isotropic:
        return None
    return -(float(surroundings.antenna.amplitude(np.array([0.0, 0.0, 1.0]))) ** 2)


def plan_response(
    material: Material,
    surroundings: Surroundings,
    crossings: Crossings,
    chirp: Chirp,
    tolerance: float,
    facet_m: NDArray[np.float64] | None = None,
) -> ResponsePlan:
    """The fewest Chebyshev frequencies that interpolate W over the band to the tolerance, relative to its maximum."""
    half_band = 0.5 * float(chirp.frequencies_hz[-1] - chirp.frequencies_hz[0])
    unit_probes = np.linspace(-1.0, 1.0, _BAND_PROBES)
    at_probes = _factor(material, surroundings, crossings, facet_m, chirp.center_hz + half_band * unit_probes)
    largest = np.abs(at_probes).max()
    for count in range(1, _MAX_FREQUENCIES + 1):
        unit = chebyshev_points(count)
        at_nodes = _factor(material, surroundings, crossings, facet_m, chirp.center_hz + half_band * unit)
        error = np.abs(np.tensordot(lagrange_weights(unit, unit_probes), at_nodes, axes=1) - at_probes)
        if error.max() <= tolerance * largest:
            break
    samples = (chirp.frequencies_hz - chirp.center_hz) / half_band
    phase = np.unwrap(np.angle(at_probes), axis=1)
    slope = np.abs(np.diff(phase, axis=1)).max() / np.radians(_PROBE_DEG[1] - _PROBE_DEG[0])
    if facet_m is not None:  # the form factor turns by its half width, for both ways
        slope += 2.0 * np.pi * chirp.center_hz / SPEED_OF_LIGHT_M_PER_S * np.linalg.norm(facet_m)
    return ResponsePlan(
        material,
        surroundings,
        crossings,
        chirp.center_hz + half_band * unit,
        lagrange_weights(unit, samples).T,
        float(slope),
        facet_m,
    )


def _factor(
    material: Material,
    surroundings: Surroundings,
    crossings: Crossings,
    facet_m: NDArray[np.float64] | None,
    frequencies_hz: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Gamma, form factor and all two-way transmissions at one common angle, (F, angles, 2) for s and p."""
    cosine = np.cos(np.radians(_PROBE_DEG))
    total = np.ones((len(frequencies_hz), len(cosine), 2), dtype=np.complex128)
    walls = [sheet.material for sheet in surroundings.sheets]
    if surroundings.box is not None and crossings != "none":
        walls += [surroundings.box.material] * (1 if crossings == "leaving" else 2)
    for row, frequency in enumerate(frequencies_hz):
        total[row] *= coherent_loss(material.roughness_m, cosine, frequency)[:, None]
        if facet_m is not None:
            cycles = 2.0 * frequency / SPEED_OF_LIGHT_M_PER_S * facet_m.max() * np.sqrt(1.0 - cosine**2)
            total[row] *= np.sinc(cycles)[:, None]
        total[row] *= np.stack(wall_reflection(material, cosine, float(frequency)), axis=-1)
        for wall in walls:
            total[row] *= np.stack(wall_transmission(wall, cosine, None, float(frequency)), axis=-1) ** 2
    return total


def wall_reflection(material: Material, cosine: NDArray[np.float64], frequency_hz: float) -> Amplitudes:
    """Gamma of a smooth surface of this material, s and p."""
    if material.permittivity is None:
        mirror = np.full(np.shape(cosine), -1.0 + 0.0j)
        return Amplitudes(mirror, mirror)
    value = material.permittivity.at(frequency_hz)
    if material.thickness_m is None:
        return fresnel_reflection(value, cosine)
    return slab_reflection(value, material.thickness_m, cosine, frequency_hz)


def wall_transmission(
    wall: Material,
    cosine: NDArray[np.float64],
    distance_m: NDArray[np.float64] | None,
    frequency_hz: float,
) -> Amplitudes:
    """What a wall lets through, over the same path in air.

    Args:
        wall: a slab.
        cosine: of the angle between its normal and the straight way.
        distance_m: from antenna to sample, for the refraction of a spherical wave; None for a plane wave.
        frequency_hz: one frequency.
    """
    if wall.permittivity is None or wall.thickness_m is None:
        raise RadarError(
            f"a wall of {wall.name} needs a permittivity and a thickness to let anything through"
        )
    value = wall.permittivity.at(frequency_hz)
    plane = slab_transmission(value, wall.thickness_m, cosine, frequency_hz)
    if distance_m is None:
        return plane
    bent = refraction_factor(value, wall.thickness_m, cosine, distance_m, frequency_hz)
    return Amplitudes(plane.s * bent, plane.p * bent)
