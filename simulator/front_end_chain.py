"""The impairments in the order of the hardware, for any block of rows of H."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_echoes import leakage_signal, room_echo, table_echo
from waveformer.simulator.front_end_noise import noise_power, signal_power, thermal_noise
from waveformer.simulator.front_end_oscillator import OscillatorPhase, with_phase_noise
from waveformer.simulator.front_end_positions import chirp_leaders
from waveformer.simulator.front_end_receiver import (
    dc_level,
    interfering_chirp,
    quantised,
    with_iq_imbalance,
)
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

_ISOTROPIC = Antenna.isotropic()


def apply_front_end(
    front_end: FrontEnd,
    h_block: ArrayLike,
    first_row: int,
    aperture: Aperture,
    chirp: Chirp,
    seed: int,
    *,
    antenna: Antenna = _ISOTROPIC,
    reference_power: float | None = None,
) -> NDArray[np.complex64]:
    """The recorded signal of some rows from their ideal one.

    Order: clutter joins the echo where the antennas really were; the radar's own delay holds for all that comes
    through the antenna; leakage and interference join at the receiver; the mixer adds the oscillator's phase noise
    (to each by its delay) and the I/Q imbalance; thermal noise comes after it because its level is defined in the
    recorded samples, and a noise figure is measured there; then the DC offset; last the ADC.

    A row's result depends on the seed and its number only, not on the block. Blocks that begin and end at
    multiples of `front_end_streams.CHUNK_ROWS` draw no random number twice.

    Args:
        front_end: what to apply; positions are not its part (`front_end_positions.true_aperture`).
        h_block: ideal signal of rows first_row .. first_row + n - 1, shape (n, T).
        first_row: number of the first row.
        aperture: all N pairs, where the antennas really were.
        chirp: T samples.
        seed: of the simulation.
        antenna: pattern for clutter and for the mirror of `mirror_snr_db`.
        reference_power: median of `signal_power` over all N rows; needed with `snr_db` unless the block holds all.

    Returns:
        Recorded signal, shape (n, T) complex64, in units of h.

    Raises:
        RadarError: the block does not fit, a reference power is missing, or clutter lies above the antennas.
    """
    h = np.array(h_block, dtype=np.complex64)
    stop = first_row + len(h)
    if h.ndim != 2 or h.shape[1] != chirp.num_samples or not 0 <= first_row < stop <= len(aperture):
        raise RadarError(
            f"front end: block of shape {h.shape} from row {first_row} does not fit {len(aperture)} rows of "
            f"{chirp.num_samples} samples"
        )
    if front_end.snr_db is not None and reference_power is None and len(h) == len(aperture):
        reference_power = float(np.median(signal_power(h)))
    noise = noise_power(front_end, chirp, antenna, reference_power)

    rows = slice(first_row, stop)
    block = Aperture(aperture.tx_m[rows], None if aperture.rx_m is None else aperture.rx_m[rows])
    if front_end.table is not None:
        h += table_echo(front_end.table, block, chirp, antenna)
    if front_end.room is not None:
        h += room_echo(front_end.room, block, chirp, antenna, seed)
    if front_end.range_bias_m:
        delay_s = front_end.range_bias_m / SPEED_OF_LIGHT_M_PER_S
        h *= np.exp(-2j * np.pi * chirp.frequencies_hz * delay_s).astype(np.complex64)
    h = _mixed(front_end, h, aperture, rows, chirp, seed)
    if front_end.iq_imbalance is not None:
        h = with_iq_imbalance(h, front_end.iq_imbalance)
    if noise:
        h += thermal_noise(noise, chirp.num_samples, first_row, stop, seed)
    if front_end.dc_offset is not None:
        h += dc_level(front_end.dc_offset)
    return h if front_end.adc is None else quantised(h, front_end.adc)


def _mixed(
    front_end: FrontEnd,
    h: NDArray[np.complex64],
    aperture: Aperture,
    rows: slice,
    chirp: Chirp,
    seed: int,
) -> NDArray[np.complex64]:
    """Echoes, leakage and interference behind a mixer whose oscillator has phase noise."""
    if front_end.phase_noise is None and front_end.interferer is None and front_end.leakage is None:
        return h
    leaders = chirp_leaders(aperture, rows.start, rows.stop)
    phase = None
    if front_end.phase_noise is not None and front_end.sample_rate_hz is not None:
        phase = OscillatorPhase(
            front_end.phase_noise, front_end.sample_rate_hz, chirp.num_samples, leaders, seed
        )
        h = with_phase_noise(h, phase, chirp)
    if front_end.leakage is not None:
        leakage = leakage_signal(front_end.leakage, chirp)
        if phase is not None:
            delay_s = front_end.leakage.path_m / SPEED_OF_LIGHT_M_PER_S
            leakage = leakage * np.exp(1j * phase.residual(np.array([delay_s]))).astype(np.complex64)
        h = h + leakage
    if front_end.interferer is not None and front_end.sample_rate_hz is not None:
        interference = interfering_chirp(front_end.interferer, chirp, front_end.sample_rate_hz, leaders, seed)
        if phase is not None:
            interference = interference * np.exp(-1j * phase.of_oscillator()).astype(np.complex64)
        h = h + interference
    return h
