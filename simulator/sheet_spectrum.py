"""Exact field of a point source behind an infinite slab: truth for sheets between radar and object.

The plane-wave (Weyl, Sommerfeld) integral over every direction, evanescent ones included, taken numerically and
not by stationary phase: refraction, walk-off, spreading and inner echoes are all in it. Only the sum of both legs
enters, so the slab may lie anywhere between the two points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import jv

from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.slab import Amplitudes, slab_transmission

# exp(-40) is below the rounding of a double
_EVANESCENT_NEPERS = 40.0
# How far the path of integration leaves the real axis, to pass above the branch point and the guided waves
_DETOUR_PER_M = 20.0
_NODES, _RADIANS_PER_PANEL = 16, 6.0


def spectrum_transmission(
    permittivity: complex,
    thickness_m: float,
    lateral_m: float,
    height_m: float,
    frequencies_hz: ArrayLike,
) -> Amplitudes:
    """Field behind a slab over that without it, for a source of s waves and one of p waves.

    The sources are the Hertz potentials along the normal of the slab (magnetic for s, electric for p): scalar
    spherical waves of which each plane-wave part crosses the slab with its own coefficient (Felsen & Marcuvitz,
    Radiation and Scattering of Waves, ch. 5; without the slab it is Weyl's identity).

    Args:
        permittivity: relative, eps' - j eps''.
        thickness_m: of the slab.
        lateral_m: distance of the two points along the slab.
        height_m: their distance along its normal, slab included.
        frequencies_hz: shape (T,).

    Returns:
        Complex ratios, each (T,); 1 for a slab of permittivity 1.

    Raises:
        RadarError: the slab does not fit between the points.
    """
    if not 0 < thickness_m < height_m:
        raise RadarError(f"a slab of {thickness_m!r} m does not fit between points {height_m!r} m apart")
    ratios = [
        _ratio(permittivity, thickness_m, lateral_m, height_m, frequency)
        for frequency in np.atleast_1d(np.asarray(frequencies_hz, float))
    ]
    return Amplitudes(*np.array(ratios, complex).T)


def _ratio(
    permittivity: complex, thickness_m: float, lateral_m: float, height_m: float, frequency_hz: float
) -> list[complex]:
    k = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT_M_PER_S
    distance = np.hypot(lateral_m, height_m)
    along, step = _path(k, distance, height_m - thickness_m)
    normal = np.sqrt(k**2 - along**2)
    normal = np.where(normal.imag > 0, -normal, normal)
    # Weyl: exp(-jkR) / R = -j integral of q / k_z J_0(q rho) exp(-j k_z z) dq
    wave = -1j * along / normal * jv(0, along * lateral_m) * np.exp(-1j * normal * height_m) * step
    free = np.exp(-1j * k * distance) / distance
    crossed = slab_transmission(permittivity, thickness_m, normal / k, frequency_hz)
    return [complex((part * wave).sum() / free) for part in crossed]


def _path(k: float, distance_m: float, air_m: float) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Wave numbers along the slab and the steps between them: nodes and weights of a Gauss rule by panels."""
    end = np.hypot(k, _EVANESCENT_NEPERS / air_m)
    panels = int(np.ceil(end * distance_m / _RADIANS_PER_PANEL)) + 20
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    edges = np.linspace(0, end, panels + 1)
    half = (edges[1:] - edges[:-1])[:, None] / 2
    real = ((edges[1:] + edges[:-1])[:, None] / 2 + half * nodes).ravel()
    step = (half * weights).ravel()
    # t^4 leaves the small angles alone, where the detour would make large numbers that cancel
    detour = _DETOUR_PER_M * (real / end) ** 4
    return real + 1j * detour, step * (1 + 4j * detour / real)
