"""Small polynomial bases with known error: what lets few evaluations stand for many.

A phase factor exp(-j phi x), x in [-1, 1], interpolated at m Chebyshev points errs by at most
``2 (phi / 2)^m / m!`` (Trefethen, Approximation Theory and Approximation Practice, theorem 8.2,
with the Bessel coefficients of the Jacobi-Anger expansion bounded by (phi / 2)^m / m!).
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray


def points_for_phase(phase_rad: float, tolerance: float) -> int:
    """Chebyshev points that interpolate exp(-j phase x) on [-1, 1] to the tolerance."""
    count, bound = 1, phase_rad
    while bound > tolerance:
        count += 1
        bound *= phase_rad / 2.0 / count  # 2 (phase / 2)^count / count!, and no overflow on the way
    return count


def chebyshev_points(count: int) -> NDArray[np.float64]:
    """Roots of the Chebyshev polynomial of degree `count`, shape (count,), increasing."""
    return np.sort(np.cos(np.pi * (np.arange(count) + 0.5) / count))


def lagrange_weights(nodes: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at `at` (N,) of the Lagrange polynomials of `nodes` (m,), shape (N, m)."""
    weights = np.ones((len(at), len(nodes)))
    for i, node in enumerate(nodes):
        for j, other in enumerate(nodes):
            if i != j:
                weights[:, i] *= (at - other) / (node - other)
    return weights


def phase_polynomial(phase_rad: NDArray[np.float64], count: int) -> NDArray[np.complex128]:
    """Monomial coefficients of exp(-j phase x) on [-1, 1].

    Args:
        phase_rad: shape (T,).
        count: number of coefficients; the error is that of `points_for_phase`.

    Returns:
        Coefficients a, shape (count, T): exp(-j phase x) ~ sum_i a[i] x^i.
    """
    nodes = chebyshev_points(count)
    values = np.exp(-1j * nodes[:, None] * phase_rad[None, :])
    coefficients = np.linalg.solve(chebyshev.chebvander(nodes, count - 1), values)
    to_monomials = np.zeros((count, count))
    for degree in range(count):
        basis = np.zeros(degree + 1)
        basis[degree] = 1.0
        polynomial = chebyshev.cheb2poly(basis)
        to_monomials[: len(polynomial), degree] = polynomial
    return np.asarray(to_monomials @ coefficients)
