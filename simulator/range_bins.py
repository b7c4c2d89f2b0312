"""Range bins with moments, and the two linear maps that lead from them to the T samples.

A contribution at range difference r lands in the bin centred on the nearest r_b with its moments
((r - r_b) / X)^i, i < 4. Over the band exp(-j kappa_t (r - r_b)), kappa_t the wavenumber offset from the
carrier, is a polynomial of the same degree to the error of `interpolation.points_for_phase`, so the
bin width does not show in the result: with X = 10 mm and 4 GHz that is 1e-3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.interpolation import phase_polynomial
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

NUM_MOMENTS = 4
BIN_WIDTH_WAVELENGTHS = 1.0


@dataclass(frozen=True, eq=False)
class RangeBins:
    """Bins over the range differences of an object to its reference point.

    Attributes:
        center_m: the reference point, shape (3,).
        wavelength_m: of the carrier, at the centre frequency.
        moment_scale_m: X, the largest range difference within a bin that the moments carry.
        count, width_m: bin b is centred on (b - count // 2) * width.
        to_samples: matrix from (bin, moment) to the T samples, (count * moments, T) complex64.
    """

    center_m: NDArray[np.float64]
    wavelength_m: float
    moment_scale_m: float
    count: int
    width_m: float
    to_samples: NDArray[np.complex64]


def range_bins(
    chirp: Chirp,
    center_m: NDArray[np.float64],
    radius_m: float,
    cell_radius_m: float,
    width_wavelengths: float | None = None,
    num_moments: int = NUM_MOMENTS,
) -> RangeBins:
    """Bins for an object within `radius_m` of its reference point, cut into cells of `cell_radius_m`."""
    wavelength = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    width = (width_wavelengths or BIN_WIDTH_WAVELENGTHS) * wavelength
    count = 2 * int(np.ceil(radius_m / width) + 1) + 1
    scale = cell_radius_m + 0.5 * width
    wavenumber_offset = 4.0 * np.pi * (chirp.frequencies_hz - chirp.center_hz) / SPEED_OF_LIGHT_M_PER_S
    polynomial = phase_polynomial(wavenumber_offset * scale, num_moments)  # (moment, T)
    bin_range_m = (np.arange(count) - count // 2) * width
    carrier = np.exp(-1j * bin_range_m[:, None] * wavenumber_offset[None, :])  # (bin, T)
    matrix = (carrier[:, None, :] * polynomial[None, :, :]).reshape(count * num_moments, -1)
    return RangeBins(center_m, wavelength, scale, count, width, matrix.astype(np.complex64))


def reference_phase(
    chirp: Chirp, aperture: Aperture, rows: NDArray[np.int64], center_m: NDArray[np.float64]
) -> NDArray[np.complex64]:
    """exp(-j 2 pi f_t path / c) to the reference point, float64 inside, shape (n, T)."""
    path = np.linalg.norm(aperture.tx_m[rows] - center_m, axis=1)
    path = path + (
        path if aperture.is_monostatic else np.linalg.norm(aperture.receivers_m[rows] - center_m, axis=1)
    )
    # exp is the cost here: T values from a fine and a coarse ladder of about sqrt(T) values each
    step = -2.0 * np.pi * chirp.bandwidth_hz / chirp.num_samples / SPEED_OF_LIGHT_M_PER_S * path
    start = -2.0 * np.pi * chirp.start_hz / SPEED_OF_LIGHT_M_PER_S * path
    fine_count = int(np.ceil(np.sqrt(chirp.num_samples)))
    fine = np.exp(1j * (start[:, None] + step[:, None] * np.arange(fine_count)))
    coarse = np.exp(1j * step[:, None] * (fine_count * np.arange(-(-chirp.num_samples // fine_count))))
    ladder = (coarse[:, :, None] * fine[:, None, :]).reshape(len(rows), -1)
    return np.asarray(ladder[:, : chirp.num_samples], dtype=np.complex64)
