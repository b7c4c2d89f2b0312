"""Every signal of a range gate comes back from a few numbers, to the accuracy that was promised."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from waveformer.simulator.compact import compact, compact_basis, range_gate, restore
from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

MITO = Chirp.from_preset("mito")
GATE_M = (0.25, 0.55)
# Every single echo is restored 40 dB better than the signal, see compact.py.
ECHO_DB = -100.0


def echoes(chirp: Chirp, ranges_m: Any) -> NDArray[np.complex128]:
    """Unit echoes of points, one row per range, straight from the contract's phase."""
    delays_s = 2 * np.atleast_1d(ranges_m) / SPEED_OF_LIGHT_M_PER_S
    return np.exp(-2j * np.pi * delays_s[:, None] * chirp.frequencies_hz)


def error_db(restored: NDArray[Any], signal: NDArray[Any]) -> NDArray[np.float64]:
    """Of every row, relative to the row."""
    lost = np.linalg.norm(restored - signal, axis=1) / np.linalg.norm(signal, axis=1)
    return np.asarray(20 * np.log10(lost))


@pytest.mark.parametrize(
    ("chirp", "gate_m"),
    [
        (MITO, GATE_M),
        (MITO, (0.4, 0.401)),
        (MITO, (0.0, 5.0)),
        (Chirp.from_preset("77-81ghz"), GATE_M),
        (Chirp(77e9, 4e9, 32), (0.3, 0.5)),
        (Chirp.from_preset("24ghz"), GATE_M),
    ],
)
def test_no_echo_inside_the_gate_errs_more_than_the_bound(chirp: Chirp, gate_m: Any) -> None:
    basis = compact_basis(chirp, gate_m)
    assert 20 * np.log10(basis.echo_error) <= ECHO_DB
    # Dense where the error is largest, at the edges.
    dense = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 2001))
    signal = echoes(chirp, gate_m[0] + dense * (gate_m[1] - gate_m[0]))
    projected = (signal @ basis.matrix.conj()) @ basis.matrix.T
    by_nodes = signal[:, basis.nodes] @ np.linalg.inv(basis.matrix[basis.nodes]).T @ basis.matrix.T
    # The phases of the test signals themselves, up to 1.6e4 rad, round to 1e-12 in float64.
    limit_db = 20 * np.log10(basis.echo_error + 1e-11)
    assert error_db(projected, signal).max() <= limit_db
    assert error_db(by_nodes, signal).max() <= limit_db
    # and the bound is no looser than the points between which it was proven allow
    assert error_db(by_nodes, signal).max() >= limit_db - 1.0


def test_a_gate_of_six_bins_takes_fifteen_numbers_instead_of_512() -> None:
    basis = compact_basis(MITO, GATE_M)
    assert basis.num_coefficients == 15
    assert compact_basis(MITO, GATE_M, tolerance_db=-40).num_coefficients < 15
    assert basis.vectors.T @ basis.vectors == pytest.approx(np.eye(15), abs=1e-10)


def test_an_echo_outside_the_gate_is_not_restored(rng: np.random.Generator) -> None:
    basis = compact_basis(MITO, GATE_M)
    signal = echoes(MITO, [GATE_M[1] + 3 * MITO.range_bin_m])
    assert error_db(basis.restore(basis.project(signal)), signal).max() > -20
    with pytest.raises(RadarError, match=r"outside the gate 0\.25 \.\. 0\.55 m.*widen the gate"):
        compact(signal.astype(np.complex64), MITO, GATE_M)


@pytest.mark.parametrize("count", [2, 300])
def test_random_sums_are_restored_to_60_db(rng: np.random.Generator, count: int) -> None:
    weights = rng.normal(size=(500, count)) + 1j * rng.normal(size=(500, count))
    signal = (weights @ echoes(MITO, rng.uniform(*GATE_M, size=count))).astype(np.complex64)
    packed = compact(signal, MITO, GATE_M)
    assert packed.coefficients.shape == (500, 15)
    assert packed.coefficients.dtype == np.complex64
    assert error_db(restore(packed), signal).max() <= -60.0


def test_a_sum_that_cancels_to_one_percent_is_still_restored_to_60_db() -> None:
    # A wall of equal echoes along range: the carrier cancels all but the ends.
    ranges_m = np.linspace(*GATE_M, 4001)
    signal = echoes(MITO, ranges_m).sum(axis=0, keepdims=True)
    assert np.linalg.norm(signal) < 0.01 * np.sqrt(512) * 4001
    basis = compact_basis(MITO, GATE_M)
    restored = (signal @ basis.matrix.conj()) @ basis.matrix.T
    assert error_db(restored, signal).max() <= -60.0


def test_a_simulator_may_compute_the_nodes_only(rng: np.random.Generator) -> None:
    basis = compact_basis(MITO, GATE_M)
    assert np.unique(basis.nodes).size == 15
    assert np.array_equal(basis.node_frequencies_hz, MITO.frequencies_hz[basis.nodes])
    weights = rng.normal(size=(50, 40)) + 1j * rng.normal(size=(50, 40))
    signal = weights @ echoes(MITO, rng.uniform(*GATE_M, size=40))
    coefficients = basis.from_nodes(signal[:, basis.nodes])
    # complex64 rounds to 6e-8 of the largest term; 15 nodes amplify it no more than tenfold.
    assert error_db(basis.restore(coefficients), signal).max() <= -100.0
    assert np.abs(coefficients - basis.project(signal)).max() <= 1e-5 * np.abs(coefficients).max()


def test_coefficients_keep_the_energy(rng: np.random.Generator) -> None:
    signal = echoes(MITO, rng.uniform(*GATE_M, size=20))
    packed = compact(signal, MITO, GATE_M)
    energy = np.linalg.norm(packed.coefficients, axis=1)
    assert energy == pytest.approx(np.linalg.norm(signal, axis=1), rel=1e-5)  # complex64 sums of 512


def test_the_gate_of_a_box_holds_every_path_to_it(rng: np.random.Generator) -> None:
    tx_m = rng.uniform(-0.2, 0.2, size=(50, 3)) * [1, 1, 0]
    aperture = Aperture(tx_m, tx_m - [0.0108, 0, 0])
    low_m, high_m = np.array([-0.1, -0.05, -0.5]), np.array([0.1, 0.05, -0.3])
    near_m, far_m = range_gate(low_m, high_m, aperture)
    points_m = rng.uniform(low_m, high_m, size=(2000, 3))
    points_m[:8] = [[x, y, z] for x in (-0.1, 0.1) for y in (-0.05, 0.05) for z in (-0.5, -0.3)]
    ways = [np.linalg.norm(points_m - a[:, None], axis=-1) for a in (tx_m, aperture.receivers_m)]
    path_m = sum(ways) / 2
    assert near_m <= path_m.min() <= near_m + 0.02
    # The farthest corner seen from both antennas is the same one here, so the bound is reached.
    assert far_m == pytest.approx(path_m.max(), rel=1e-12)
    with pytest.raises(RadarError, match="two corners"):
        range_gate(high_m, low_m, aperture)


@pytest.mark.parametrize(
    ("gate_m", "says"),
    [
        ((0.5, 0.5), "near < far"),
        ((-0.1, 0.5), "near < far"),
        ((0.1, np.nan), "near < far"),
        ((0.1,), "near < far"),
        ((0.0, 25.5), "needs all 512 samples"),
        ((0.0, 30.0), "needs all 512 samples"),
    ],
)
def test_a_senseless_gate_is_refused(gate_m: Any, says: str) -> None:
    with pytest.raises(RadarError, match=says):
        compact_basis(MITO, gate_m)


def test_senseless_arguments_are_refused() -> None:
    with pytest.raises(RadarError, match="tolerance_db"):
        compact_basis(MITO, GATE_M, tolerance_db=-150)
    with pytest.raises(RadarError, match=r"h must be complex of shape \(N, 512\)"):
        compact(np.zeros((3, 511), complex), MITO, GATE_M)
    signal = echoes(MITO, [0.4])
    signal[0, 3] = np.nan
    with pytest.raises(RadarError, match="outside the gate"):
        compact(signal, MITO, GATE_M)
