"""How the factor W of a target varies over band and angle, and so where the kernels must evaluate it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.box_crossings import bounding_corners, leaving_changes, leaving_wall
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

# What a wall is described by: real and imaginary part of its permittivity, and its thickness in metres.
Component = Literal["real", "imaginary", "thickness"]

_MAX_FREQUENCIES = 24
_BAND_PROBES = 49
# Angles at which the smoothness of W is judged, and the largest: beyond it a way hardly carries anything.
_ANGLE_PROBES = 31
_STEEPEST_RAD = np.radians(85.0)


class WallChange(NamedTuple):
    """One number that matter is described by.

    Attributes:
        wall: sheets in their order, then the box; None for the surface of the target.
        component: real and imaginary part of the permittivity, thickness in metres, roughness in metres.
    """

    wall: int | None
    component: Component | Literal["roughness"]


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
        surface_wall: which wall the surface belongs to (see `WallChange`); None for a target.
        facet_growth: of `facet_m` with the thickness of that wall, shape (3,); None if it stays.
    """

    material: Material
    surroundings: Surroundings
    crossings: Crossings
    frequencies_hz: NDArray[np.float64]
    to_samples: NDArray[np.complex128] | NDArray[np.float64]
    phase_per_radian: float
    facet_m: NDArray[np.float64] | None = None
    surface_wall: int | None = None
    facet_growth: NDArray[np.float64] | None = None


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
    bounds_m: NDArray[np.float64],
    antennas_m: NDArray[np.float64],
    facet_m: NDArray[np.float64] | None = None,
    neighbours: Sequence[tuple[Material, Surroundings]] = (),
) -> ResponsePlan:
    """The fewest Chebyshev frequencies that interpolate W over the band.

    What is interpolated is W over its spectrum S at one angle, where that helps: W(f) = S(f) sum_m L_m(f) W(f_m) / S(f_m)
    is exact at that angle, and the ripple of a slab changes little from angle to angle. Judged over the angles that occur: of the ways through each wall from the bounding boxes of target and antennas,
    and of incidence on the target over all angles, weighed with the cosine as the echo is.

    Args:
        material, surroundings, crossings, facet_m: see `ResponsePlan`.
        chirp: T samples.
        tolerance: largest error of the interpolation over the largest W.
        bounds_m: corners of the target's bounding box, shape (2, 3).
        antennas_m: antennas, shape (A, 3).
        neighbours: matter that differs a little; the difference of W is interpolated to the tolerance of its own
            size, too, so that derivatives are right.
    """
    half_band = 0.5 * float(chirp.frequencies_hz[-1] - chirp.frequencies_hz[0])
    widest = _widest_angles(surroundings, crossings, bounds_m, antennas_m)

    def factor(unit: NDArray[np.float64]) -> NDArray[np.complex128]:
        """W and its differences to the neighbours, (F, 1 + neighbours, 2, 2, angles)."""
        frequencies = chirp.center_hz + half_band * unit
        scenes = [(material, surroundings), *neighbours]
        own, *others = (_factor(*scene, crossings, facet_m, widest, frequencies) for scene in scenes)
        return np.stack([own, *(other - own for other in others)], axis=1)

    unit_probes = np.linspace(-1.0, 1.0, _BAND_PROBES)
    at_probes = factor(unit_probes)
    largest = np.abs(at_probes).max(axis=(0, 2, 3, 4), keepdims=True)
    samples = (chirp.frequencies_hz - chirp.center_hz) / half_band
    at_samples = factor(samples)
    # the spectrum of normal incidence, of a middle angle, or none
    middle = _ANGLE_PROBES // 3
    references = [*(angle for angle in (0, middle) if _divides(at_probes[:, 0, 0, angle, 0])), None]
    for count, reference in itertools.product(range(1, _MAX_FREQUENCIES + 1), references):
        unit = chebyshev_points(count)
        at_nodes = factor(unit)
        spectra = [
            np.ones(len(part)) if reference is None else part[:, 0, 0, reference, 0]
            for part in (at_probes, at_nodes, at_samples)
        ]
        weights = lagrange_weights(unit, unit_probes) * spectra[0][:, None] / spectra[1]
        error = np.abs(np.tensordot(weights, at_nodes, axes=1) - at_probes)
        if (error <= tolerance * largest).all():
            break
    # of W itself, not of its phase, which jumps where W passes through zero
    change = np.abs(np.diff(at_probes[:, 0], axis=2)).max() / (np.pi / 2 / (_ANGLE_PROBES - 1))
    slope = float(change / largest.flat[0]) if largest.flat[0] > 0 else 0.0
    if facet_m is not None:  # the form factor turns by its half width, for both ways
        slope += 2.0 * np.pi * chirp.center_hz / SPEED_OF_LIGHT_M_PER_S * float(np.linalg.norm(facet_m))
    return ResponsePlan(
        material,
        surroundings,
        crossings,
        chirp.center_hz + half_band * unit,
        (lagrange_weights(unit, samples) * spectra[2][:, None] / spectra[1]).T,
        slope,
        facet_m,
    )


def _divides(spectrum: NDArray[np.complex128]) -> bool:
    """Whether a spectrum is far from zero over the band."""
    return bool(np.abs(spectrum).min() > 0.2 * np.abs(spectrum).max())


def _widest_angles(
    surroundings: Surroundings,
    crossings: Crossings,
    bounds_m: NDArray[np.float64],
    antennas_m: NDArray[np.float64],
) -> list[float]:
    """Largest angle between a way and the normal of each sheet, then of the box's walls if any is crossed."""
    targets, antennas = bounding_corners(bounds_m), bounding_corners(antennas_m)
    ways = (antennas[:, None] - targets).reshape(-1, 3)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    normals = [np.asarray(sheet.normal) for sheet in surroundings.sheets]
    box = surroundings.box
    if box is None or crossings == "none":
        return [_widest(ways @ normal) for normal in normals]
    if crossings == "leaving" and not leaving_changes(box, targets, 0.0, antennas).any():
        # the box is convex: if all corners leave by the same wall, all ways do
        axes = np.unique(leaving_wall(box, targets, antennas[0])[0] // 2)
        if len(axes) == 1:
            return [_widest(ways @ normal) for normal in [*normals, np.eye(3)[axes[0]]]]
    return [*(_widest(ways @ normal) for normal in normals), _STEEPEST_RAD]


def _widest(cosines: NDArray[np.float64]) -> float:
    return float(min(_STEEPEST_RAD, np.arccos(np.abs(cosines).clip(0.0, 1.0)).max()))


def _factor(
    material: Material,
    surroundings: Surroundings,
    crossings: Crossings,
    facet_m: NDArray[np.float64] | None,
    widest_rad: list[float],
    frequencies_hz: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """W cos over the band for s and p, (F, 2, angles, 2).

    First the ways through the walls turn from zero to their largest angle while the surface is hit at normal
    incidence, then the other way round.
    """
    steps, still = np.linspace(0.0, 1.0, _ANGLE_PROBES), np.zeros(_ANGLE_PROBES)
    cosine = np.cos(np.stack([still, steps]) * _STEEPEST_RAD)
    total = np.ones((len(frequencies_hz), *cosine.shape, 2), dtype=np.complex128)
    walls = [sheet.material for sheet in surroundings.sheets]
    if surroundings.box is not None and crossings != "none":
        walls.append(surroundings.box.material)
    for row, frequency in enumerate(frequencies_hz):
        total[row] *= (cosine * coherent_loss(material.roughness_m, cosine, frequency))[..., None]
        if facet_m is not None:
            cycles = 2.0 * frequency / SPEED_OF_LIGHT_M_PER_S * facet_m.max() * np.sqrt(1.0 - cosine**2)
            total[row] *= np.sinc(cycles)[..., None]
        total[row] *= np.stack(wall_reflection(material, cosine, float(frequency)), axis=-1)
        for wall, widest in zip(walls, widest_rad, strict=True):
            angles = np.cos(np.stack([steps, still]) * widest)
            through = wall_transmission(wall, angles, None, float(frequency))
            times = 4 if crossings == "any" and wall is walls[-1] and surroundings.box is not None else 2
            total[row] *= np.stack(through, axis=-1) ** times
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
