"""Signals that the scene does not know of: a table, a room, and the leakage inside the radar."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_settings import Leakage, RoomClutter, TableClutter
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.plane_image import heights_over, way_by_plane
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

_BLOCK_ROWS = 256

FloatArray = NDArray[np.float64]


def table_echo(
    table: TableClutter, aperture: Aperture, chirp: Chirp, antenna: Antenna
) -> NDArray[np.complex64]:
    """Echo of an infinite plane by its image, for every pair, shape (N, T).

    Raises:
        RadarError: the plane does not lie below the antennas.
    """
    tx, rx = aperture.tx_m, aperture.receivers_m
    point, normal = np.array([0.0, 0.0, table.z_m]), np.array([0.0, 0.0, 1.0])
    if min(heights_over(antennas, point, normal).min() for antennas in (tx, rx)) <= 0:
        raise RadarError(f"table at z = {table.z_m:g} m must lie below the antennas, which look down")
    path, mirror_point = way_by_plane(tx, rx, point, normal)
    gains = antenna.amplitude(tx - mirror_point) * antenna.amplitude(rx - mirror_point)
    strength = table.reflection * gains / (4 * np.pi * path)
    return _delayed_sum(strength[:, None], path[:, None], chirp, chirp.wavelengths_m)


def room_points(room: RoomClutter, seed: int) -> FloatArray:
    """Places of the scatterers, shape (count, 3)."""
    return generator(seed, "room").uniform(room.min_m, room.max_m, size=(room.count, 3))


def room_echo(
    room: RoomClutter, aperture: Aperture, chirp: Chirp, antenna: Antenna, seed: int
) -> NDArray[np.complex64]:
    """Echo of all scatterers by the radar equation, for every pair, shape (N, T)."""
    points = room_points(room, seed)
    h = np.empty((len(aperture), chirp.num_samples), dtype=np.complex64)
    for start in range(0, len(aperture), _BLOCK_ROWS):
        rows = slice(start, start + _BLOCK_ROWS)
        out, back = (
            antennas[rows, None, :] - points[None] for antennas in (aperture.tx_m, aperture.receivers_m)
        )
        out_m, back_m = np.linalg.norm(out, axis=2), np.linalg.norm(back, axis=2)
        strength = np.sqrt(room.rcs_m2) * antenna.amplitude(out) * antenna.amplitude(back)
        strength /= (4 * np.pi) ** 1.5 * out_m * back_m
        h[rows] = _delayed_sum(strength, out_m + back_m, chirp, chirp.wavelengths_m)
    return h


def leakage_signal(leakage: Leakage, chirp: Chirp) -> NDArray[np.complex64]:
    """The signal that every pair receives from inside the radar, shape (1, T)."""
    strength = np.full((1, 1), 10.0 ** (leakage.level_db / 20.0))
    return _delayed_sum(strength, np.full((1, 1), leakage.path_m), chirp, np.ones(chirp.num_samples))


def _delayed_sum(
    strength: FloatArray, path_m: FloatArray, chirp: Chirp, over_frequency: FloatArray
) -> NDArray[np.complex64]:
    """Sum over echoes of strength * over_frequency(f_t) * exp(-2 pi j f_t path / c).

    Args:
        strength, path_m: of n rows and S echoes, shape (n, S).
        chirp: T samples.
        over_frequency: common factor over frequency, shape (T,).
    """
    # exp(-j k_t path) splits into coarse and fine steps of frequency: two small matrices instead of n S T phases
    fine = 16
    coarse = -(-chirp.num_samples // fine)
    step_hz = chirp.bandwidth_hz / chirp.num_samples
    turns = -2j * np.pi / SPEED_OF_LIGHT_M_PER_S * path_m
    starts = chirp.start_hz + step_hz * fine * np.arange(coarse)
    leading = np.exp(turns[:, None, :] * starts[:, None]) * strength[:, None, :]
    trailing = np.exp(turns[:, :, None] * (step_hz * np.arange(fine)))
    # Phases are float64; their products sum in single precision, the precision of h.
    h = np.matmul(leading.astype(np.complex64), trailing.astype(np.complex64))
    h = h.reshape(len(path_m), coarse * fine)[:, : chirp.num_samples]
    return np.asarray(h * over_frequency.astype(np.float32))
