"""What a radar does to the ideal signal: the impairments by name, and radars by name.

Each impairment is one field, off by default; `front_end_chain.apply_front_end` applies them in the order of the
hardware. Levels are relative to the transmitted power, as ``|h|^2`` is.
"""

from __future__ import annotations

from typing import Any

from pydantic import Field, model_validator

from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_settings import (
    Adc,
    DcOffset,
    Interferer,
    IqImbalance,
    Leakage,
    PhaseNoise,
    RoomClutter,
    Settings,
    TableClutter,
)
from waveformer.simulator.presets import lookup_preset

_NOISE_LEVELS = ("snr_db", "mirror_snr_db", "noise_figure_db")


class FrontEnd(Settings):
    """Impairments of a radar; `FrontEnd()` is ideal.

    Thermal noise is set by at most one of `snr_db`, `mirror_snr_db` and `noise_figure_db`.

    Attributes:
        snr_db: power of the strongest bin of the object's range profile (no window, median over antenna pairs) over
            the mean noise power of a bin.
        mirror_snr_db: the same with a perfect flat mirror at 0.4 m in place of the object.
        noise_figure_db: noise figure of the receiver; with `transmit_power_dbm` and `sample_rate_hz` it gives
            k T F fs per complex sample at T = 290 K (Friis 1944). Antenna gains are already in h.
        transmit_power_dbm: power at the antenna port, for `noise_figure_db`.
        sample_rate_hz: rate of the complex samples; needed by `noise_figure_db`, `phase_noise`, `interferer`.
        position_jitter_m: where the radar really was: standard deviation of x, y and z at each position, drawn
            once for all receivers of a position (robot repeatability, ISO 9283).
        row_depth_error_m: standard deviation of one error in z for each raster row, the positions of one y.
        range_bias_m: delay inside the radar as additional round-trip path, exp(-j 2 pi f b / c).
        table: clutter of a flat surface.
        room: clutter of a room.
        leakage: from transmitter to receiver.
        interferer: another radar's chirp.
        phase_noise: of the chirp generator.
        iq_imbalance: of the quadrature mixer.
        dc_offset: of mixer and IF amplifier.
        adc: quantisation and saturation.

    Raises:
        RadarError: an unknown field (the known ones are named), a value out of range, two kinds of thermal noise,
            or a field without one that it needs.
    """

    snr_db: float | None = None
    mirror_snr_db: float | None = None
    noise_figure_db: float | None = Field(default=None, ge=0.0)
    transmit_power_dbm: float | None = None
    sample_rate_hz: float | None = Field(default=None, gt=0.0)
    position_jitter_m: float = Field(default=0.0, ge=0.0)
    row_depth_error_m: float = Field(default=0.0, ge=0.0)
    range_bias_m: float = 0.0
    table: TableClutter | None = None
    room: RoomClutter | None = None
    leakage: Leakage | None = None
    interferer: Interferer | None = None
    phase_noise: PhaseNoise | None = None
    iq_imbalance: IqImbalance | None = None
    dc_offset: DcOffset | None = None
    adc: Adc | None = None

    @model_validator(mode="after")
    def _consistent(self) -> FrontEnd:
        given = [name for name in _NOISE_LEVELS if getattr(self, name) is not None]
        if len(given) > 1:
            raise RadarError(f"FrontEnd: {' and '.join(given)} both set the thermal noise; give one")
        if (self.noise_figure_db is None) != (self.transmit_power_dbm is None):
            raise RadarError(
                "FrontEnd: noise_figure_db and transmit_power_dbm make a link budget together; give both"
            )
        for name in ("noise_figure_db", "phase_noise", "interferer"):
            if getattr(self, name) is not None and self.sample_rate_hz is None:
                raise RadarError(f"FrontEnd: {name} needs sample_rate_hz, the rate of the complex samples")
        half_rate_hz = (self.sample_rate_hz or 0.0) / 2
        if self.interferer is not None and self.interferer.filter_hz > half_rate_hz:
            raise RadarError(
                f"FrontEnd: interferer.filter_hz {self.interferer.filter_hz:g} exceeds half the sample rate, "
                f"{half_rate_hz:g} Hz: the filter would not keep aliases out"
            )
        return self

    @classmethod
    def from_preset(cls, name: str) -> FrontEnd:
        """The front end of a named radar (`FRONT_END_PRESETS`)."""
        return cls.model_validate(lookup_preset("front end", FRONT_END_PRESETS, name))

    @property
    def is_ideal(self) -> bool:
        """True if nothing is switched on; a sample rate alone does nothing."""
        return not set(self.model_dump(exclude_defaults=True)) - {"sample_rate_hz"}

    def describe(self) -> dict[str, Any]:
        """What is switched on, as plain JSON values; `FrontEnd(**described)` is the same front end."""
        return self.model_dump(mode="json", exclude_defaults=True)


FRONT_END_PRESETS: dict[str, dict[str, Any]] = {
    "ideal": {},
    # TI IWR1443 on its evaluation board with the settings of MITO (10 MS/s complex).
    "iwr1443": {
        # Data sheet SWRS211, RF specification, 77-81 GHz: 12 dBm, 15 dB, -93 dBc/Hz at 1 MHz. A younger chip of the
        # family has 13.5 dBm, 12 dB, -95 dBc/Hz (SWRS330).
        "noise_figure_db": 15.0,
        "transmit_power_dbm": 12.0,
        "sample_rate_hz": 10e6,
        # The loop bandwidth is not published; 300 kHz is usual for a 77 GHz synthesiser (estimate).
        "phase_noise": {"level_dbc_hz": -93.0, "offset_hz": 1e6, "loop_hz": 300e3},
        # Estimate: image 30 dB below the echo, as integrated quadrature receivers reach without correction.
        "iq_imbalance": {"gain_db": 0.3, "phase_deg": 3.0},
        # Estimate: 35 dB between antennas 5 mm apart, and as much again by the high-pass filters of the IF, whose
        # lowest corner of 175 kHz stands at a round trip of 0.9 m.
        "leakage": {"level_db": -70.0, "path_m": 0.01},
        # Compression at -29 dBm with the default receive gain of 30 dB (maker's forum: -23 dBm at 24 dB, -35 dBm
        # at 36 dB), below 12 dBm; recorded as int16.
        "adc": {"bits": 16, "full_scale_db": -41.0},
    },
    # Occlusion aside, what a simulated twin of MITO needs to match the published rows. The levels hold for some
    # 7,700 positions: with MITO's 44,000 positions x 4 receivers the same image takes 14 dB more noise. 0.15 m is
    # the bias that MITO's own imaging takes out.
    "mito_los": {"mirror_snr_db": 50.0, "range_bias_m": 0.15},
    # Behind cardboard the twin matches with 10 dB more noise and 0.2 mm of depth error between robot rows; the
    # cardboard itself belongs into the scene.
    "mito_nlos": {"mirror_snr_db": 40.0, "range_bias_m": 0.15, "row_depth_error_m": 2e-4},
}
