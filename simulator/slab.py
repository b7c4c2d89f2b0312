"""What a flat interface or a thin wall sends back and lets through, in float64: the twin of `reflection`.

Written from the textbook, not from the kernel: the slab is two interfaces and the phase between them.

Time factor exp(+j omega t), permittivity eps' - j eps''. s: E perpendicular to the plane of incidence, p: in it.
Both share the sign that makes them equal at normal incidence, so a good conductor has Gamma -> -1 in both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S

# Beyond about 73 degrees the expansion of `refraction_factor` in d / R fails: its value there is kept.
SMALLEST_REFRACTION_COSINE = 0.3


class Amplitudes(NamedTuple):
    """Complex amplitude coefficients of both polarisations."""

    s: NDArray[np.complex128]
    p: NDArray[np.complex128]


def fresnel_reflection(permittivity: ArrayLike, cosine: ArrayLike) -> Amplitudes:
    """Reflection of a half space (Born & Wolf 1.5.2; ITU-R P.2040-3, eq. 31).

    Args:
        permittivity: relative, eps' - j eps''.
        cosine: of the angle of incidence, above 0 and up to 1, or the complex one of an evanescent wave;
            broadcasts with the permittivity.

    Returns:
        Amplitude at the interface, the broadcast shape.
    """
    eps, cos, inside = _inside(permittivity, cosine)
    return Amplitudes((cos - inside) / (cos + inside), (inside - eps * cos) / (inside + eps * cos))


def slab_reflection(
    permittivity: ArrayLike, thickness_m: ArrayLike, cosine: ArrayLike, frequency_hz: ArrayLike
) -> Amplitudes:
    """Reflection of a slab in air with all its inner echoes (Born & Wolf 1.6.4; ITU-R P.2040-3, eq. 43).

    Args:
        permittivity: relative, eps' - j eps''.
        thickness_m: of the slab.
        cosine: as for `fresnel_reflection`.
        frequency_hz: all four broadcast.

    Returns:
        Amplitude with its phase at the face that is hit, the broadcast shape.
    """
    once = _phase_through(permittivity, thickness_m, cosine, frequency_hz)
    faces = fresnel_reflection(permittivity, cosine)
    return Amplitudes(*(face * (1 - once**2) / (1 - (face * once) ** 2) for face in faces))


def slab_transmission(
    permittivity: ArrayLike, thickness_m: ArrayLike, cosine: ArrayLike, frequency_hz: ArrayLike
) -> Amplitudes:
    """Transmission of a slab over that of the same path in air, t exp(+j k d cos) (ITU-R P.2040-3, eq. 44).

    Arguments and shapes as for `slab_reflection`. A slab of permittivity 1 gives 1.
    """
    once = _phase_through(permittivity, thickness_m, cosine, frequency_hz)
    air = np.exp(1j * _wavenumber(frequency_hz) * np.asarray(thickness_m) * np.asarray(cosine))
    faces = fresnel_reflection(permittivity, cosine)
    return Amplitudes(*((1 - face**2) * once * air / (1 - (face * once) ** 2) for face in faces))


def refraction_factor(
    permittivity: ArrayLike,
    thickness_m: ArrayLike,
    cosine: ArrayLike,
    distance_m: ArrayLike,
    frequency_hz: ArrayLike,
) -> NDArray[np.complex128]:
    """What `slab_transmission` at the straight line lacks for a spherical wave: walk-off and spreading.

    A plane wave meets the slab at one angle. Between two points at a distance R the ray is bent: it leaves
    displaced by s = d sin (1 / cos - 1 / q), q = sqrt(eps - sin^2), and seems to come from a nearer source. To
    first order in d / R, from the slope and the curvatures of the phase k d (cos - q) over the transverse wave
    numbers:

        (1 - s sin / R - d / (2 R) (eps cos^2 / q^3 + 1 / q - 2 / cos)) exp(-j k s^2 cos^2 / (2 R))

    The cosine is taken as at least `SMALLEST_REFRACTION_COSINE`. Derived by saddle point and judged by `sheet_spectrum`; inner echoes are taken to shift as the wave itself.

    Args:
        permittivity: relative, eps' - j eps''.
        thickness_m: d of the slab, much less than the distance.
        cosine: of the angle between the straight line and the normal of the slab.
        distance_m: R between the two points, along the straight line.
        frequency_hz: all five broadcast.

    Returns:
        Complex factor on the one-way transmission, the same for both polarisations.
    """
    eps, cos, inside = _inside(permittivity, np.maximum(cosine, SMALLEST_REFRACTION_COSINE))
    depth = np.asarray(thickness_m) / np.asarray(distance_m)
    sine_squared = 1 - cos**2
    walk = 1 / cos - 1 / inside
    spreading = depth / 2 * (eps * cos**2 / inside**3 + 1 / inside - 2 / cos)
    bend = _wavenumber(frequency_hz) * np.asarray(thickness_m) * depth / 2 * sine_squared * (walk * cos) ** 2
    return np.asarray((1 - depth * sine_squared * walk - spreading) * np.exp(-1j * bend))


def coherent_loss(roughness_m: ArrayLike, cosine: ArrayLike, frequency_hz: ArrayLike) -> NDArray[np.float64]:
    """Amplitude that a rough surface keeps in the mirror direction, exp(-2 (k sigma cos)^2) (Ament 1953)."""
    phase = _wavenumber(frequency_hz) * np.asarray(roughness_m) * np.asarray(cosine)
    return np.asarray(np.exp(-2 * phase**2))


def _inside(
    permittivity: ArrayLike, cosine: ArrayLike
) -> tuple[NDArray[np.complex128], NDArray[Any], NDArray[np.complex128]]:
    """Permittivity, cosine, and the normal component of the wave vector inside, over k: sqrt(eps - sin^2)."""
    eps, cos = np.asarray(permittivity, complex), np.asarray(cosine)
    # eps - 1 + cos^2, and not eps - sin^2, is exactly cos^2 where eps is 1
    inside = np.sqrt(eps - 1 + cos**2)
    # the root that decays into the slab
    return eps, cos, np.where(inside.imag > 0, -inside, inside)


def _phase_through(
    permittivity: ArrayLike, thickness_m: ArrayLike, cosine: ArrayLike, frequency_hz: ArrayLike
) -> NDArray[np.complex128]:
    inside = _inside(permittivity, cosine)[2]
    return np.asarray(np.exp(-1j * _wavenumber(frequency_hz) * np.asarray(thickness_m) * inside))


def _wavenumber(frequency_hz: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(2 * np.pi * np.asarray(frequency_hz, float) / SPEED_OF_LIGHT_M_PER_S)
