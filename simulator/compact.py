"""Range-gated signals in K numbers per position instead of T samples, and back.

An echo from range r turns by ``exp(-j 2 pi f_t tau)``, tau = 2 r / c. If every echo lies between two ranges, the
samples of a chirp, once turned back by the delay of the gate's middle, are band-limited sequences, and those lie
in the span of a few discrete prolate spheroidal sequences: about one per range bin of the gate, and some ten
more for accuracy (D. Slepian, "Prolate spheroidal wave functions, Fourier analysis, and uncertainty V: the
discrete case", Bell System Technical Journal 57, 1978).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

# Echoes of one surface cancel each other while their restoration errors need not. Every single echo is
# therefore restored 40 dB better than asked, which covers sums as small as 1 % of their terms; it takes
# three or four more numbers per position.
_CANCELLATION_DB = 40.0
_CHUNK_POSITIONS = 4096


@dataclass(frozen=True, eq=False)
class CompactBasis:
    """The K-dimensional space in which all signals of a range gate lie.

    Attributes:
        chirp: T samples.
        near_m, far_m: the gate, half the round-trip path, range bias included.
        vectors: orthonormal sequences, shape (T, K) float64, for signals turned back to the gate's middle.
        nodes: K sample numbers of the chirp, ascending, int64; a signal of the gate follows from these alone.
        echo_error: bound on the restoration error of any one echo inside the gate, relative to the echo, from
            coefficients and from nodes alike. Restoration of any sum of echoes errs by no more than this
            times the sum of their amplitudes.
    """

    chirp: Chirp
    near_m: float
    far_m: float
    vectors: NDArray[np.float64]
    nodes: NDArray[np.int64]
    echo_error: float

    @property
    def num_coefficients(self) -> int:
        """K."""
        return len(self.nodes)

    @property
    def node_frequencies_hz(self) -> NDArray[np.float64]:
        """Frequencies at which a simulator needs to compute H, shape (K,)."""
        return np.asarray(self.chirp.frequencies_hz[self.nodes])

    @cached_property
    def matrix(self) -> NDArray[np.complex128]:
        """Orthonormal columns M, shape (T, K): H = C @ M.T and C = H @ M.conj()."""
        delay_s = (self.near_m + self.far_m) / SPEED_OF_LIGHT_M_PER_S
        turned = np.exp(-2j * np.pi * delay_s * self.chirp.frequencies_hz)[:, None] * self.vectors
        return np.asarray(turned, dtype=np.complex128)

    def project(self, h: ArrayLike) -> NDArray[np.complex64]:
        """Coefficients (N, K) of full signals (N, T)."""
        return _multiply(h, self.matrix.conj(), "h")

    def from_nodes(self, h_nodes: ArrayLike) -> NDArray[np.complex64]:
        """Coefficients (N, K) of signals known at `node_frequencies_hz` only, shape (N, K)."""
        return _multiply(h_nodes, np.asarray(np.linalg.inv(self.matrix[self.nodes])).T, "h_nodes")

    def restore(self, coefficients: ArrayLike) -> NDArray[np.complex64]:
        """Full signals (N, T) of coefficients (N, K)."""
        return _multiply(coefficients, self.matrix.T, "coefficients")


@dataclass(frozen=True, eq=False)
class CompactSignal:
    """H of a range gate.

    Attributes:
        coefficients: shape (N, K) complex64; their energy is that of H.
        basis: what they multiply.
    """

    coefficients: NDArray[np.complex64]
    basis: CompactBasis

    def __post_init__(self) -> None:
        expected = (len(self.coefficients), self.basis.num_coefficients)
        if self.coefficients.shape != expected or not np.iscomplexobj(self.coefficients):
            raise RadarError(
                f"coefficients must be complex of shape (positions, {expected[1]}), got "
                f"{self.coefficients.dtype} {self.coefficients.shape}"
            )


def compact(
    h: ArrayLike, chirp: Chirp, gate_m: Sequence[float], *, tolerance_db: float = -60.0
) -> CompactSignal:
    """Signals of a range gate by their coefficients.

    Args:
        h: shape (N, T).
        chirp: T samples.
        gate_m: nearest and farthest half round trip of any echo, see `range_gate`.
        tolerance_db: restoration error allowed, relative to H.

    Raises:
        RadarError: the gate makes no sense, or H holds more outside it than tolerance_db allows.
    """
    basis = compact_basis(chirp, gate_m, tolerance_db=tolerance_db)
    signals = np.asarray(h)
    coefficients = basis.project(signals)
    lost = energy = 0.0
    for start in range(0, len(signals), _CHUNK_POSITIONS):
        rows = slice(start, start + _CHUNK_POSITIONS)
        energy += float(np.linalg.norm(signals[rows])) ** 2
        lost += float(np.linalg.norm(signals[rows] - basis.restore(coefficients[rows]))) ** 2
    # Written so that a NaN is refused as well.
    if not lost <= 10 ** (tolerance_db / 10) * energy:
        share_db = 10 * np.log10(lost / energy)
        raise RadarError(
            f"the signal holds {share_db:.0f} dB of its energy outside the gate {basis.near_m:g} .. {basis.far_m:g} m, "
            f"more than {tolerance_db:g} dB: widen the gate (walls, range bias, noise?) or keep all samples"
        )
    return CompactSignal(coefficients, basis)


def restore(signal: CompactSignal) -> NDArray[np.complex64]:
    """The full signals, shape (N, T), that `compact` was given, within its tolerance."""
    return signal.basis.restore(signal.coefficients)


def compact_basis(chirp: Chirp, gate_m: Sequence[float], *, tolerance_db: float = -60.0) -> CompactBasis:
    """The smallest prolate spheroidal basis that restores every echo of a range gate.

    The bound is proven, not sampled: up to 1e-12, the restoration error is a polynomial of degree m in the
    delay (Jacobi-Anger expansion), and between the 8 m Chebyshev points, where it is evaluated, a polynomial
    exceeds its largest value by no more than 1 / cos(pi / 16) (H. Ehlich, K. Zeller, "Schwankung von Polynomen
    zwischen Gitterpunkten", Mathematische Zeitschrift 86, 1964).

    Args:
        chirp: T samples.
        gate_m: nearest and farthest half round trip of any echo.
        tolerance_db: restoration error allowed, relative to the signal, -100 to -20.

    Raises:
        RadarError: the gate is no interval, or so wide that nothing is saved.
    """
    from scipy.signal.windows import dpss

    near_m, far_m = _gate(gate_m)
    if not -100.0 <= tolerance_db <= -20.0:
        raise RadarError(
            f"tolerance_db must lie in -100 .. -20, which complex64 can hold, got {tolerance_db!r}"
        )
    num_samples = chirp.num_samples
    # Half the time-bandwidth product: range bins in half the gate.
    half_bins = (far_m - near_m) / (2.0 * chirp.range_bin_m)
    candidates = min(num_samples, int(np.ceil(2.0 * half_bins)) + 40)
    allowed = 10.0 ** ((tolerance_db - _CANCELLATION_DB) / 20.0)
    if half_bins < num_samples / 2:
        vectors = dpss(num_samples, half_bins, candidates).T
        echoes = _echoes(num_samples, half_bins)
        # What the first k sequences miss of an echo is what the others hold.
        missed = np.cumsum(np.abs(vectors.T @ echoes)[::-1] ** 2, axis=0)[::-1].max(axis=1) ** 0.5
        for size in np.flatnonzero(missed <= allowed * np.cos(np.pi / 16)):
            chosen = vectors[:, :size]
            nodes = _nodes(chosen)
            missed_by_nodes = echoes - chosen @ np.linalg.solve(chosen[nodes], echoes[nodes])
            error = float(np.linalg.norm(missed_by_nodes, axis=0).max() / np.cos(np.pi / 16))
            if error <= allowed:
                return CompactBasis(chirp, near_m, far_m, chosen.copy(), nodes, error)
    raise RadarError(
        f"a gate of {near_m:g} .. {far_m:g} m needs all {num_samples} samples of this chirp, whose unambiguous range "
        f"is {chirp.unambiguous_range_m:g} m: narrow the gate or keep the samples"
    )


def range_gate(low_m: ArrayLike, high_m: ArrayLike, aperture: Aperture) -> tuple[float, float]:
    """Bounds of half the round-trip path by way of any point of a box, e.g. of the bounds of a scene.

    Args:
        low_m, high_m: opposite corners, shape (3,), radar frame.
        aperture: N antenna pairs.

    Returns:
        Least and greatest (R_tx + R_rx) / 2 in metres; add half the range bias, if there is one.
    """
    low, high = np.asarray(low_m, dtype=np.float64), np.asarray(high_m, dtype=np.float64)
    if (
        low.shape != (3,)
        or high.shape != (3,)
        or not (np.isfinite([low, high]).all() and (low <= high).all())
    ):
        raise RadarError(
            f"a box needs two corners (3,), low <= high, in metres, got {low_m!r} and {high_m!r}"
        )
    nearest, farthest = np.zeros(len(aperture)), np.zeros(len(aperture))
    for antennas in (aperture.tx_m, aperture.receivers_m):
        outside = np.maximum(0.0, np.maximum(low - antennas, antennas - high))
        nearest += np.linalg.norm(outside, axis=1) / 2
        farthest += np.linalg.norm(np.maximum(np.abs(low - antennas), np.abs(high - antennas)), axis=1) / 2
    return float(nearest.min()), float(farthest.max())


def _echoes(num_samples: int, half_bins: float) -> NDArray[np.complex128]:
    """Unit-norm echoes at the Chebyshev points of a gate, shape (T, points), seen from its middle."""
    # Bessel functions J_m(x) fall below 1e-12 beyond m = x + 12 x^(1/3).
    largest = np.pi * half_bins
    degree = int(np.ceil(largest + 12.0 * (1.0 + largest) ** (1 / 3)))
    points = np.cos(np.pi * (np.arange(8 * degree) + 0.5) / (8 * degree))
    centred = (np.arange(num_samples) - (num_samples - 1) / 2) / num_samples
    return np.asarray(np.exp(-2j * np.pi * half_bins * np.outer(centred, points)) / np.sqrt(num_samples))


def _nodes(vectors: NDArray[np.float64]) -> NDArray[np.int64]:
    """Samples from which all others follow with little amplification: pivots of a QR factorisation."""
    from scipy.linalg import qr

    pivots = qr(vectors.T, mode="r", pivoting=True)[1]
    return np.sort(pivots[: vectors.shape[1]]).astype(np.int64)


def _gate(gate_m: Sequence[float]) -> tuple[float, float]:
    gate = np.asarray(gate_m, dtype=np.float64)
    if gate.shape != (2,) or not np.isfinite(gate).all() or not 0.0 <= gate[0] < gate[1]:
        raise RadarError(f"a range gate is (near, far) in metres, 0 <= near < far, got {gate_m!r}")
    return float(gate[0]), float(gate[1])


def _multiply(signals: ArrayLike, matrix: NDArray[np.complex128], name: str) -> NDArray[np.complex64]:
    left = np.asarray(signals)
    if left.ndim != 2 or left.shape[1] != len(matrix) or not np.iscomplexobj(left):
        raise RadarError(f"{name} must be complex of shape (N, {len(matrix)}), got {left.dtype} {left.shape}")
    return left.astype(np.complex64, copy=False) @ np.ascontiguousarray(matrix, dtype=np.complex64)
