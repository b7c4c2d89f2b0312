"""Chebyshev bases: the promised error bounds hold, and polynomials come back exactly."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.interpolation import (
    chebyshev_points,
    lagrange_weights,
    phase_polynomial,
    points_for_phase,
)

ON_UNIT_INTERVAL = np.linspace(-1.0, 1.0, 1001)


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("phase_rad", [0.0, 1e-4, 0.03, 0.5, 1.7, 4.0, 13.0, 40.0])
def test_the_points_for_a_phase_interpolate_it_to_the_tolerance(phase_rad: float, tolerance: float) -> None:
    nodes = chebyshev_points(points_for_phase(phase_rad, tolerance))
    weights = lagrange_weights(nodes, ON_UNIT_INTERVAL)
    error = np.abs(weights @ np.exp(-1j * phase_rad * nodes) - np.exp(-1j * phase_rad * ON_UNIT_INTERVAL))
    assert error.max() <= tolerance + 1e-12  # float64 rounding over 70 nodes


@pytest.mark.parametrize("phase_rad", [0.5, 4.0, 13.0])
def test_the_points_for_a_phase_are_not_many_more_than_needed(phase_rad: float) -> None:
    count = points_for_phase(phase_rad, 1e-6)
    nodes = chebyshev_points(count - 2)
    values = lagrange_weights(nodes, ON_UNIT_INTERVAL) @ np.exp(-1j * phase_rad * nodes)
    assert np.abs(values - np.exp(-1j * phase_rad * ON_UNIT_INTERVAL)).max() > 1e-6


def test_more_phase_or_less_tolerance_never_needs_fewer_points() -> None:
    counts = [points_for_phase(phase, 1e-3) for phase in np.linspace(0, 30, 200)]
    assert (np.diff(counts) >= 0).all()
    assert points_for_phase(3.0, 1e-6) > points_for_phase(3.0, 1e-3)
    assert points_for_phase(0.0, 1e-12) == 1


@pytest.mark.parametrize("phase_rad", [150.0, 1000.0])
def test_a_large_phase_needs_many_points_and_does_not_overflow(phase_rad: float) -> None:
    # at least two points a cycle, 2 phase / (2 pi) cycles on [-1, 1]
    assert phase_rad / np.pi * 2 < points_for_phase(phase_rad, 1e-3) < 2.0 * phase_rad


def test_chebyshev_points_are_the_increasing_roots() -> None:
    for count in (1, 2, 5, 16):
        points = chebyshev_points(count)
        assert np.cos(count * np.arccos(points)) == pytest.approx(np.zeros(count), abs=1e-13)
        assert (np.diff(points) > 0).all()
        assert points == pytest.approx(-points[::-1], abs=1e-15)


def test_lagrange_weights_sum_to_one_and_are_one_at_their_node(rng: np.random.Generator) -> None:
    nodes = chebyshev_points(7)
    assert lagrange_weights(nodes, nodes) == pytest.approx(np.eye(7), abs=1e-13)
    assert lagrange_weights(nodes, rng.uniform(-1, 1, 50)).sum(axis=1) == pytest.approx(np.ones(50))


def test_lagrange_weights_reproduce_every_polynomial_of_lower_degree(rng: np.random.Generator) -> None:
    nodes, at = np.sort(rng.uniform(-2, 3, 6)), rng.uniform(-2, 3, 40)
    polynomial = np.polynomial.Polynomial(rng.normal(size=6))
    # rounding grows with the Lebesgue constant of random nodes, which may reach 1e3
    assert lagrange_weights(nodes, at) @ polynomial(nodes) == pytest.approx(
        polynomial(at), rel=1e-9, abs=1e-9
    )


@pytest.mark.parametrize("count", [2, 4, 8])
def test_the_phase_polynomial_errs_by_no_more_than_its_bound(count: int) -> None:
    phases = np.array([-2.0, -0.4, 0.0, 0.05, 0.4, 2.0])
    coefficients = phase_polynomial(phases, count)
    assert coefficients.shape == (count, 6)
    values = np.stack([ON_UNIT_INTERVAL**i for i in range(count)], axis=1) @ coefficients
    error = np.abs(values - np.exp(-1j * ON_UNIT_INTERVAL[:, None] * phases)).max(axis=0)
    factorial = np.prod(np.arange(1, count + 1, dtype=float))
    assert (error <= 2.0 * (np.abs(phases) / 2.0) ** count / factorial + 1e-12).all()  # plus rounding


def test_the_phase_polynomial_starts_as_one_minus_j_phase_x() -> None:
    coefficients = phase_polynomial(np.array([0.01]), 4)[:, 0]
    # the expansion of exp(-j 0.01 x); the fit differs from it by 0.01^4 / 4!
    assert coefficients == pytest.approx(np.array([1, -0.01j, -0.5e-4, 1e-6j / 6]), abs=1e-9)
