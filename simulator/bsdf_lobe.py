"""The mirror spread into a lobe: how a surface of the coherent sum looks to an incoherent renderer.

Directions are in the local frame of Mitsuba, normal +z, both on the upper side.
"""

from __future__ import annotations

import math
from typing import Any

import drjit as dr

from waveformer.simulator.bsdf_parameters import BsdfParameters
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.reflection import Coefficients, coherent_loss, wall_coefficients

# Nearly diffuse: 53 degrees off the mirror direction at 1/e. Wider slopes would send a good part of the power into the
# surface, and single scattering would lose it.
_MAX_SLOPE = 0.5


class MirrorLobe:
    """A microfacet lobe of Beckmann's slopes with Smith's shadowing around the mirror direction.

    A rough surface has two: the coherent one, weakened by Ament's factor A(cos) = exp(-(2 k sigma cos)^2), and
    the rough one, which takes what the coherent one lost. The factors are A at the larger of both cosines and
    1 - A at the smaller: at every pair of directions they are reciprocal, at every incidence they sum to at most
    1, and in the mirror direction to 1.
    """

    def __init__(self, parameters: BsdfParameters) -> None:
        """Opaque Dr.Jit values, so that two materials share one compiled kernel."""
        import mitsuba as mi

        material = parameters.material
        self._wavenumber = dr.opaque(
            mi.Float, wavenumber := math.tau * parameters.frequency_hz / SPEED_OF_LIGHT_M_PER_S
        )
        self._permittivity = None
        if material.permittivity is not None:
            value = material.permittivity.at(parameters.frequency_hz)
            self._permittivity = mi.Complex2f(
                dr.opaque(mi.Float, value.real), dr.opaque(mi.Float, value.imag)
            )
        self._thickness = None if material.thickness_m is None else dr.opaque(mi.Float, material.thickness_m)
        # a facet's tilt moves the reflected direction by twice as much
        slope = math.tan(math.radians(parameters.lobe_width_deg) / 2)
        self._slope = dr.opaque(mi.Float, slope)
        self._roughness = None
        if material.roughness_m > 0.0:
            self._roughness = dr.opaque(mi.Float, material.roughness_m)
            spread = rough_slope(wavenumber, material.roughness_m, parameters.correlation_length_m)
            self._rough_slope = dr.opaque(mi.Float, min(math.hypot(slope, spread), _MAX_SLOPE))

    def reflectance(self, cosine: Any) -> Any:
        """Power reflected by the smooth surface, mean of both polarisations."""
        if self._permittivity is None:
            return dr.full(type(self._wavenumber), 1.0, dr.width(cosine))
        wall = self._coefficients(cosine)
        return 0.5 * (dr.squared_norm(wall.reflect_s) + dr.squared_norm(wall.reflect_p))

    def transmittance(self, cosine: Any) -> Any:
        """Power let through by a slab, mean of both polarisations."""
        wall = self._coefficients(cosine)
        return 0.5 * (dr.squared_norm(wall.transmit_s) + dr.squared_norm(wall.transmit_p))

    def eval(self, wi: Any, wo: Any) -> Any:
        """BRDF times cos(wo)."""
        half = dr.normalize(wi + wo)
        density = dr.zeros(type(wi.z))
        for weight, slopes in self._lobes(wi.z, wo.z):
            density += weight * slopes.eval(half) * slopes.G(wi, wo, half)
        return self.reflectance(dr.dot(wi, half)) * density / (4.0 * wi.z)

    def pdf(self, wi: Any, wo: Any) -> Any:
        """Density of `sample` per solid angle."""
        half = dr.normalize(wi + wo)
        density = dr.zeros(type(wi.z))
        for weight, slopes in self._lobes(wi.z, wi.z):
            density += weight * slopes.pdf(wi, half)
        return density / (4.0 * dr.dot(wo, half))

    def sample(self, wi: Any, sample1: Any, sample2: Any) -> Any:
        """A direction wo, by the visible slopes of the lobe that `sample1` picks; may point below the surface."""
        import mitsuba as mi

        slope = self._slope
        if self._roughness is not None:
            slope = dr.select(sample1 < self._kept(wi.z), self._slope, self._rough_slope)
        half, _ = _slopes(slope).sample(wi, sample2)
        return mi.reflect(wi, half)

    def _lobes(self, cosine_one: Any, cosine_two: Any) -> list[tuple[Any, Any]]:
        """(weight, distribution of slopes) of every lobe."""
        if self._roughness is None:
            return [(1.0, _slopes(self._slope))]
        is_one_larger = cosine_one > cosine_two
        kept = self._kept(dr.select(is_one_larger, cosine_one, cosine_two))
        lost = 1.0 - self._kept(dr.select(is_one_larger, cosine_two, cosine_one))
        return [(kept, _slopes(self._slope)), (lost, _slopes(self._rough_slope))]

    def _kept(self, cosine: Any) -> Any:
        return dr.square(coherent_loss(self._roughness, cosine, self._wavenumber))

    def _coefficients(self, cosine: Any) -> Coefficients:
        return wall_coefficients(self._permittivity, self._thickness, cosine, self._wavenumber)


def rough_slope(wavenumber_per_m: float, roughness_m: float, correlation_length_m: float) -> float:
    """Beckmann's slope parameter of the power that roughness scatters, from its correlation length L.

    The scattered power is a series of lobes exp(-(k L sin theta)^2 / m), theta the tilt of the half vector,
    weighted with g^m / m!, g = (2 k sigma)^2 (Beckmann & Spizzichino 1963, ch. 5). At the mean m the slope is
    sqrt(m) / (k L), from 1 / (k L) for a nearly smooth surface to the rms slopes' 2 sigma / L for a very rough one.
    """
    roughness = (2.0 * wavenumber_per_m * roughness_m) ** 2
    mean_order = roughness / -math.expm1(-roughness)
    return math.sqrt(mean_order) / (wavenumber_per_m * correlation_length_m)


def _slopes(slope: Any) -> Any:
    import mitsuba as mi

    return mi.MicrofacetDistribution(mi.MicrofacetType.Beckmann, slope, sample_visible=True)
