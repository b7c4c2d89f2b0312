"""Exact echo of a conducting or dielectric sphere between dipoles at finite distance: near-field truth.

The scattering part of the sphere's dyadic Green function (Tai, Dyadic Green Functions in Electromagnetic
Theory, ch. 10) for a dipole on the polar axis, where only the azimuthal order m = 1 remains. Time factor
exp(+j omega t), outgoing waves h_n^(2). It knows neither physical optics nor a mesh.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import spherical_jn, spherical_yn

from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S


def sphere_echo(
    radius_m: float,
    center_m: ArrayLike,
    tx_m: ArrayLike,
    rx_m: ArrayLike | None,
    frequencies_hz: ArrayLike,
    permittivity: complex | None = None,
) -> NDArray[np.complex128]:
    """Echo of a sphere, E perpendicular to the plane of transmitter, receiver and centre.

    Args:
        radius_m: radius of the sphere.
        center_m: its centre, shape (3,).
        tx_m: transmitters, shape (N, 3).
        rx_m: receivers, shape (N, 3); None means monostatic.
        frequencies_hz: shape (T,).
        permittivity: relative, eps' - j eps'', of a homogeneous sphere; None for a perfect conductor.

    Returns:
        h = sqrt(Pr / Pt) with phase, shape (N, T), scaled to isotropic antennas of unit gain.
    """
    center = np.asarray(center_m, float)
    tx = np.atleast_2d(np.asarray(tx_m, float)) - center
    rx = tx if rx_m is None else np.atleast_2d(np.asarray(rx_m, float)) - center
    k = 2 * np.pi * np.atleast_1d(np.asarray(frequencies_hz, float)) / SPEED_OF_LIGHT_M_PER_S
    d_tx, d_rx = np.linalg.norm(tx, axis=1), np.linalg.norm(rx, axis=1)
    if not (min(d_tx.min(), d_rx.min()) > radius_m > 0):
        raise RadarError("sphere series needs a positive radius and every antenna outside the sphere")
    cos_theta = np.clip((tx * rx).sum(-1) / (d_tx * d_rx), -1, 1)
    a_n, b_n = _coefficients(k * radius_m, permittivity)
    echo = np.zeros((len(tx), len(k)), dtype=complex)
    waves_tx = _OutgoingWaves(np.outer(d_tx, k))
    waves_rx = waves_tx if rx_m is None else _OutgoingWaves(np.outer(d_rx, k))
    pi_n, pi_last = np.ones_like(cos_theta), np.zeros_like(cos_theta)  # pi_1, pi_0
    for n in range(1, len(a_n) + 1):
        h_tx, dh_tx = next(waves_tx)
        h_rx, dh_rx = (h_tx, dh_tx) if rx_m is None else next(waves_rx)
        tau_n = n * cos_theta * pi_n - (n + 1) * pi_last
        term = a_n[n - 1] * h_tx * h_rx * tau_n[:, None] + b_n[n - 1] * dh_tx * dh_rx * pi_n[:, None]
        echo += (2 * n + 1) / (n * (n + 1)) * term
        # Bohren & Huffman eq. 4.47, pi_n = P_n^1 / sin(theta): both pi_n and tau_n are n(n+1)/2 at theta = 0
        pi_n, pi_last = ((2 * n + 1) * cos_theta * pi_n - (n + 1) * pi_last) / n, pi_n
    # G_xx = -(jk / 4 pi) sum, and h = lambda G_xx because free space has G = exp(-jkR) / (4 pi R)
    return np.asarray(-0.5j * echo)


def sphere_rcs_m2(
    radius_m: float, frequencies_hz: ArrayLike, permittivity: complex | None = None
) -> NDArray[np.float64]:
    """Exact monostatic radar cross-section (Mie series; permittivity None for a conductor), shape (T,)."""
    k = 2 * np.pi * np.atleast_1d(np.asarray(frequencies_hz, float)) / SPEED_OF_LIGHT_M_PER_S
    a_n, b_n = _coefficients(k * radius_m, permittivity)
    n = np.arange(1, len(a_n) + 1)[:, None]
    # h_n -> j^(n+1) exp(-jx)/x and [x h_n]'/x -> j^n exp(-jx)/x: their squares differ by a sign
    amplitude = ((2 * n + 1) * (-1.0) ** n * (a_n - b_n)).sum(axis=0)
    return np.asarray(np.pi * np.abs(amplitude) ** 2 / k**2)


def _coefficients(
    ka: NDArray[np.float64], permittivity: complex | None
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Scattering coefficients of the TE (A_n) and TM (B_n) waves, each (n_max, T) for n = 1 .. n_max.

    Bohren & Huffman eq. 4.88 with the sign of Tai; a conductor is the limit of a large index.
    """
    # Wiscombe's count (Applied Optics 19, 1980) with ten orders to spare
    orders = np.ceil(ka + 4.05 * np.cbrt(ka) + 10).astype(int)
    n = np.arange(1, orders.max() + 1)[:, None]
    used = n <= orders[None]
    n_used = np.where(used, n, 1)  # beyond a frequency's own count y_n may overflow and the term is nil
    j_n, y_n = spherical_jn(n_used, ka), spherical_yn(n_used, ka)
    h_n = j_n - 1j * y_n
    dj_n = ka * spherical_jn(n_used - 1, ka) - n_used * j_n  # [x j_n]' = x j_{n-1} - n j_n
    dh_n = ka * (spherical_jn(n_used - 1, ka) - 1j * spherical_yn(n_used - 1, ka)) - n_used * h_n
    if permittivity is None:
        return np.where(used, -j_n / h_n, 0), np.where(used, -dj_n / dh_n, 0)
    # psi = x j_n, xi = x h_n: the x cancels in TE but for psi'
    index = np.sqrt(complex(permittivity))
    inside = _logarithmic_derivative(len(n), index * ka)
    te = -(dj_n - index * inside * ka * j_n) / (dh_n - index * inside * ka * h_n)
    tm = -(dj_n - inside / index * ka * j_n) / (dh_n - inside / index * ka * h_n)
    return np.where(used, te, 0), np.where(used, tm, 0)


def _logarithmic_derivative(n_max: int, x: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """psi_n'(x) / psi_n(x), n = 1 .. n_max, shape (n_max, T): downward recurrence (Bohren & Huffman eq. 4.89)."""
    largest = np.abs(x).max()
    # A wrong start fades beyond the turning point n = |x| only, by exp(-1.9 (n - x)^1.5 x^-0.5):
    # 8 x^(1/3) more give 3e-19
    start = int(max(n_max, largest + 8 * np.cbrt(largest))) + 16
    derivative = np.zeros((start + 1, len(x)), dtype=complex)
    for n in range(start, 0, -1):
        derivative[n - 1] = n / x - 1 / (derivative[n] + n / x)
    return derivative[1 : n_max + 1]


class _OutgoingWaves:
    """Iterator over h_n^(2)(x) and [x h_n^(2)(x)]' / x for n = 1, 2, ...

    Upward recurrence: h_n grows with n past the turning point, so its relative error does not.
    """

    def __init__(self, x: NDArray[np.float64]) -> None:
        self._x, self._n = x, 0
        self._last = 1j * np.exp(-1j * x) / x  # h_0
        self._this = self._last * (1 / x + 1j)  # h_1 = -exp(-jx) (1 - j/x) / x

    def __next__(self) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        self._n += 1
        n, h_last, h_n = self._n, self._last, self._this
        derivative = h_last - n / self._x * h_n
        self._last, self._this = h_n, (2 * n + 1) / self._x * h_n - h_last
        return h_n, derivative
