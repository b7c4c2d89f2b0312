"""What a flat interface or a thin wall sends back and lets through, in Dr.Jit.

The one implementation that decides what matter does to a wave: the coherent sum, the sheets and boxes and the
Mitsuba BSDFs all call it. Its NumPy float64 twin is `slab`.

Time factor exp(+j omega t), permittivity eps' - j eps''. Both polarisations share the sign that makes them equal at
normal incidence, so a good conductor has Gamma -> -1 in both.
"""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import drjit as dr

from waveformer.simulator.slab import SMALLEST_REFRACTION_COSINE

# A wave along the surface: the limit of the formulas, kept off 0 / 0 (permittivity 1).
_GRAZING_COSINE = 1e-4


class Coefficients(NamedTuple):
    """Amplitude coefficients of a wall, complex; s: E perpendicular to the plane of incidence, p: in it.

    Attributes:
        reflect_s, reflect_p: reflection, phase at the face that is hit.
        transmit_s, transmit_p: transmission over that of the same path in air: t exp(+j k d cos); None for a
            half space.
    """

    reflect_s: Any
    reflect_p: Any
    transmit_s: Any | None
    transmit_p: Any | None


def wall_coefficients(
    permittivity: Any, thickness_m: Any | None, cosine: Any, wavenumber_per_m: Any
) -> Coefficients:
    """Fresnel's half space or the slab with all its inner echoes (Born & Wolf 1.6; ITU-R P.2040-3, eq. 37 - 44).

    Args:
        permittivity: complex Dr.Jit number eps' - j eps''.
        thickness_m: of the wall; None for a half space.
        cosine: of the angle of incidence, 0 .. 1.
        wavenumber_per_m: in air.
    """
    cosine = dr.select(cosine > _GRAZING_COSINE, cosine, _GRAZING_COSINE)
    # eps - sin^2 without rounding where eps is 1
    inside = dr.sqrt(complex_number(dr.real(permittivity) - 1.0 + cosine * cosine, dr.imag(permittivity)))
    reflect = (
        (cosine - inside) / (cosine + inside),
        (inside - permittivity * cosine) / (inside + permittivity * cosine),
    )
    if thickness_m is None:
        return Coefficients(*reflect, None, None)
    phase = wavenumber_per_m * thickness_m
    once = dr.exp(complex_number(dr.imag(inside) * phase, (cosine - dr.real(inside)) * phase))
    twice = dr.exp(complex_number(2.0 * dr.imag(inside) * phase, -2.0 * dr.real(inside) * phase))
    rings = [1.0 / (1.0 - gamma * gamma * twice) for gamma in reflect]
    back = [gamma * (1.0 - twice) * ring for gamma, ring in zip(reflect, rings, strict=True)]
    through = [(1.0 - gamma * gamma) * once * ring for gamma, ring in zip(reflect, rings, strict=True)]
    return Coefficients(back[0], back[1], through[0], through[1])


def refraction_terms(
    permittivity: Any, thickness_m: Any, cosine: Any, wavenumber_per_m: Any
) -> tuple[Any, Any]:
    """What a wall's transmission at the straight line lacks for a spherical wave: spreading and walk-off.

    The formula and its derivation: `slab.refraction_factor`.

    Args:
        permittivity, thickness_m, cosine, wavenumber_per_m: as in `wall_coefficients`.

    Returns:
        Complex a and b in metres: over a distance R the factor on the one-way transmission of both polarisations is
        (1 - a / R) exp(-j b / R).
    """
    cosine = dr.select(cosine > SMALLEST_REFRACTION_COSINE, cosine, SMALLEST_REFRACTION_COSINE)
    square = cosine * cosine
    inside = dr.sqrt(complex_number(dr.real(permittivity) - 1.0 + square, dr.imag(permittivity)))
    slowness = 1.0 / inside
    walk = dr.rcp(cosine) - slowness
    curvature = permittivity * square * slowness * slowness * slowness + slowness - 2.0 * dr.rcp(cosine)
    spreading = walk * (thickness_m * (1.0 - square)) + curvature * (0.5 * thickness_m)
    return spreading, (walk * walk) * (
        0.5 * wavenumber_per_m * thickness_m * thickness_m * (1.0 - square) * square
    )


def coherent_loss(roughness_m: Any, cosine: Any, wavenumber_per_m: Any) -> Any:
    """Amplitude that a rough surface keeps in the mirror direction, exp(-2 (k sigma cos)^2) (Ament 1953)."""
    phase = wavenumber_per_m * roughness_m * cosine
    return dr.exp(-2.0 * phase * phase)


def complex_number(real: Any, imaginary: Any) -> Any:
    """The complex type that belongs to the floats given."""
    return sys.modules[type(real).__module__].Complex2f(real, imaginary)
