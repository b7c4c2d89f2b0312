"""Simulated range response of candidate surfaces: what each level would echo into the compared bins.

mmNorm marches 4 million rays through the field for every level and antenna. Here the points of a level are
summed as physical optics does, weight * exp(-2 j k_c R) with the exact carrier into range bins of 0.7 mm, and
a constant matrix turns these into the bins of the window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.model.range_window import RangeWindow, dirichlet
from waveformer.model.surfaces import SurfaceStack
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp
from waveformer.simulator.runtime import activate

# 0.7 mm for 3 GHz. A point in a bin's corner is wrong by (pi / 2) / 72 = 0.02 rad at the ends of the band.
BINS_PER_RANGE_BIN = 72
_MAX_HISTOGRAM_VALUES = 1 << 23


def range_responses(
    stack: SurfaceStack,
    num_levels: int,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
    chirp: Chirp,
    window: RangeWindow,
    coherent: bool = True,
) -> NDArray[np.complex64] | NDArray[np.float32]:
    """Profile of every level in the bins of the window, in the scale of `measured_profiles` but for one factor.

    A point weighs area * cos / (R_tx R_rx), cos the mean cosine of the two ways, and nothing if it faces away
    from either antenna. Surfaces do not shadow one another.

    Args:
        stack: points, level after level.
        num_levels: L; a level without points answers zero.
        tx_m, rx_m: antennas, (n, 3); rx_m None means monostatic.
        chirp: the radar's.
        window: of these antennas.
        coherent: sum with phase; otherwise powers, as if every patch had a phase of its own.

    Returns:
        Complex amplitudes, shape (L, n, W); powers (float) if not coherent.

    Raises:
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    activate()
    from waveformer.model.kernel_range_response import HistogramBins, range_histograms

    low, high = stack.points_m.min(axis=0), stack.points_m.max(axis=0)
    center = 0.5 * (low + high)
    near, far = range_limits(low, high, tx_m, rx_m)
    width = chirp.range_bin_m / BINS_PER_RANGE_BIN
    bins = HistogramBins(float(near.min()) - width, width, int((far.max() - near.min()) / width) + 4)
    zero = np.zeros((len(stack.points_m), 1))
    table = np.concatenate([stack.points_m - center, stack.normals, stack.areas_m2[:, None], zero], axis=1)
    starts = np.searchsorted(stack.level, np.arange(num_levels + 1))
    wavelength = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    range_m, column = window.lattice()
    matrix = dirichlet(chirp, bins.first_m + np.arange(bins.count)[:, None] * width - range_m)
    matrix = (matrix if coherent else matrix**2).astype(np.float32)
    reference = np.linalg.norm(tx_m - center, axis=1)
    if rx_m is not None:
        reference = 0.5 * (reference + np.linalg.norm(rx_m - center, axis=1))
    carrier = np.exp(-4j * np.pi / wavelength * reference).astype(np.complex64)

    response = np.empty((num_levels, *window.bins.shape), dtype=np.complex64 if coherent else np.float32)
    step = max(1, _MAX_HISTOGRAM_VALUES // (num_levels * bins.count))
    for first in range(0, len(tx_m), step):
        rows = slice(first, first + step)
        receivers = None if rx_m is None else rx_m[rows] - center
        histograms = range_histograms(
            table, starts, tx_m[rows] - center, receivers, bins, wavelength if coherent else 0.0
        )
        parts = [histograms[..., part] @ matrix for part in range(2 if coherent else 1)]
        profile = parts[0] + 1j * parts[1] if coherent else parts[0]
        response[:, rows] = np.take_along_axis(profile, column[None, rows], axis=2)
    return response * carrier[:, None] if coherent else response


def range_limits(
    low_m: NDArray[np.float64],
    high_m: NDArray[np.float64],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Range of the nearest and the farthest point of a box from every antenna, means of both ways, (n,) each.

    Args:
        low_m, high_m: opposite corners, shape (3,).
        tx_m, rx_m: antennas, (n, 3); rx_m None means monostatic.
    """
    ranges = []
    for side in (tx_m, tx_m if rx_m is None else rx_m):
        outside = np.maximum(0.0, np.maximum(low_m - side, side - high_m))
        across = np.maximum(np.abs(side - low_m), np.abs(side - high_m))
        ranges.append((np.linalg.norm(outside, axis=1), np.linalg.norm(across, axis=1)))
    (near_tx, far_tx), (near_rx, far_rx) = ranges
    return 0.5 * (near_tx + near_rx), 0.5 * (far_tx + far_rx)
