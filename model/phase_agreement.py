"""How steadily the measured phase follows the phase simulated for the chosen surface, across the aperture.

The complex correlation c_n of the two profiles of antenna n carries the residual phase. Noise makes it random
from antenna to antenna, an error of a whole robot row from row to row, a wrong depth over wider distances.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.clusters import group_by_lattice

# Blocks must hold several of 200 antennas of a 0.3 x 0.4 m aperture.
BLOCK_EDGE_M = 0.1
_CANDIDATES = 16
# Distances across the wanted axis count this much more, and a pair must lie this well along it.
_ELONGATION = 4.0


def profile_correlation(measured: NDArray[Any], simulated: NDArray[Any]) -> NDArray[np.complex128]:
    """c_n = sum_w conj(s) m / (|s| |m|) of profiles (..., n, W), shape (..., n); 0 where either is zero."""
    # in double, because products of weak echoes underflow
    simulated, measured = simulated.astype(np.complex128), measured.astype(np.complex128)
    product = np.einsum("...w,...w->...", simulated.conj(), measured)
    scale = np.linalg.norm(simulated, axis=-1) * np.linalg.norm(measured, axis=-1)
    return np.asarray(np.where(scale > 0, product / np.where(scale > 0, scale, 1.0), 0.0))


def neighbour_rows(
    centers_m: NDArray[np.float64], rows: NDArray[np.int64]
) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Nearest neighbours of some antennas along x and along y.

    Args:
        centers_m: phase centres of all antennas, shape (N, 3).
        rows: antennas whose neighbours are wanted, shape (n,).

    Returns:
        Pairs (lower, upper) along x and along y: a steady slope of the phase turns all of a direction alike.
        Antennas without a neighbour in a direction are left out, and a direction without any pair too.
    """
    from scipy.spatial import cKDTree

    pairs = []
    for axis in (0, 1):
        stretch = np.full(2, _ELONGATION)
        stretch[axis] = 1.0
        flat = centers_m[:, :2] * stretch
        _, candidates = cKDTree(flat).query(flat[rows], k=min(_CANDIDATES, len(flat)))
        candidates = candidates.reshape(len(rows), -1)
        steps = np.abs(centers_m[candidates, :2] - centers_m[rows, None, :2])
        along = (candidates != rows[:, None]) & (steps[..., axis] > steps[..., 1 - axis])
        found = along.any(axis=1)
        nearest = candidates[np.arange(len(rows)), along.argmax(axis=1)]
        if found.any():
            ends = np.stack([rows[found], nearest[found]])
            ends = np.take_along_axis(ends, np.argsort(centers_m[ends, axis], axis=0), axis=0)
            pairs.append((ends[0], ends[1]))
    return pairs


def pair_agreement(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> float:
    """|mean of c_i conj(c_j)| over pairs: 1 if both profiles fit and the residual phase is steady, 0 if random."""
    return float(np.abs((first * second.conj()).mean()))


def block_agreement(correlation: NDArray[np.complex128], centers_m: NDArray[np.float64]) -> float:
    """Length of the sum of c_n within blocks of 0.1 m of the aperture, summed over blocks, per antenna.

    Blocks of a single antenna say nothing and are left out; 0 if there are no others.

    Args:
        correlation: shape (n,).
        centers_m: phase centres of these antennas, shape (n, 3).
    """
    group = group_by_lattice(centers_m, BLOCK_EDGE_M)
    size = np.bincount(group)
    sums = np.bincount(group, correlation.real) + 1j * np.bincount(group, correlation.imag)
    shared = size > 1
    return float(np.abs(sums[shared]).sum() / size[shared].sum()) if shared.any() else 0.0
