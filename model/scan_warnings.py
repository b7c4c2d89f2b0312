"""What about a scan spoils an image before it is formed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from waveformer.simulator.measurement import Measurement

# A wavelength: with 0.3 m of aperture at 0.4 m coarser grids put side lobes of the grid into the imaged volume.
_COARSEST_WAVELENGTHS = 1.06
# Largest share of the pitch by which the distance to the nearest neighbour may scatter in a regular raster.
_REGULAR_SCATTER = 0.15
# A receiver at the end of its scale repeats one value; noise and echoes hardly do.
_SATURATED_SHARE = 0.02


def scan_warnings(measurement: Measurement) -> tuple[str, ...]:
    """One sentence for everything that will show as a background in the image: sparse, jittered, saturated.

    Args:
        measurement: the scan.
    """
    found = []
    antennas = 0.5 * (measurement.aperture.tx_m + measurement.aperture.receivers_m)
    pitch_m = _nearest_m(antennas)
    wavelength_m = float(measurement.chirp.wavelengths_m[0])
    if len(pitch_m):
        coarse_m = _raster_pitch_m(antennas)
        if coarse_m > _COARSEST_WAVELENGTHS * wavelength_m:
            found.append(
                f"antennas are {1e3 * coarse_m:.1f} mm apart, more than a wavelength of {1e3 * wavelength_m:.1f} mm: "
                "side lobes of the raster fill the image; scan more finely"
            )
        if (
            float(np.std(pitch_m)) > _REGULAR_SCATTER * float(np.mean(pitch_m))
            and coarse_m > 0.5 * wavelength_m
        ):
            found.append(
                "antennas lie irregularly and half a wavelength or more apart: a floor of side lobes hides weak "
                "reflections; thin a scan by a regular raster only"
            )
    parts = np.abs(np.concatenate([measurement.h.real, measurement.h.imag], axis=1))
    largest = float(parts.max(initial=0.0))
    share = float((parts >= 0.999 * largest).mean()) if largest > 0 else 0.0
    if share > _SATURATED_SHARE:
        found.append(
            f"{100 * share:.0f} % of the samples have the largest value: the receiver was saturated; lower its gain"
        )
    return tuple(found)


def _nearest_m(antennas: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of every distinct antenna to the nearest other one."""
    distinct = np.unique(np.round(antennas, 6), axis=0)
    if len(distinct) < 2:
        return np.empty(0)
    return np.asarray(KDTree(distinct).query(distinct, k=2)[0][:, 1])


def _raster_pitch_m(antennas: NDArray[np.float64]) -> float:
    """Pitch of a square raster that covers the same area with as many antennas."""
    distinct = np.unique(np.round(antennas, 6), axis=0)
    sides = np.sort(np.ptp(distinct, axis=0))[::-1]
    count = len(distinct)
    if sides[1] < 1e-3:
        return float(sides[0] / (count - 1))
    # (sides + pitch) / pitch positions along each side
    a, b, c = count - 1.0, -(sides[0] + sides[1]), -sides[0] * sides[1]
    return float((-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a))
