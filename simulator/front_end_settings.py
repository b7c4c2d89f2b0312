"""The parameters of a front end's impairments: one small frozen model each, off unless given."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ModelWrapValidatorHandler, ValidationError, model_validator

from waveformer.simulator.errors import RadarError


class Settings(BaseModel):
    """Base of all settings here: frozen, finite numbers, unknown keys refused and the known ones named."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    @model_validator(mode="wrap")
    @classmethod
    def _one_line(cls, values: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        try:
            return handler(values)
        except ValidationError as error:
            problems = error.errors()
            unknown = [str(problem["loc"][0]) for problem in problems if problem["type"] == "extra_forbidden"]
            if unknown:
                known = ", ".join(cls.model_fields)
                raise RadarError(f"{cls.__name__}: unknown {', '.join(unknown)}; known: {known}") from None
            first = problems[0]
            where = ".".join([cls.__name__, *map(str, first["loc"])])
            raise RadarError(f"{where}: {first['msg']}, got {first['input']!r}") from None


class PhaseNoise(Settings):
    """Phase noise of the chirp generator, common to transmitter and local oscillator.

    Single-sideband level over the offset f from the carrier: flat inside the loop of the synthesiser, falling by
    20 dB a decade outside, L(f) = level (1 + (offset / loop)^2) / (1 + (f / loop)^2), cut off at half the sample
    rate by the IF filter. What transmitter and oscillator have in common cancels at short delay, as
    4 sin(pi f tau)^2 (Budge and Burt 1993, "Range correlation effects on phase noise spectra"; Siddiq et al. 2019,
    "Phase noise in FMCW radar systems", IEEE Trans. AES 55(1)).

    Attributes:
        level_dbc_hz: level at `offset_hz`, dBc/Hz.
        offset_hz: offset from the carrier at which it holds.
        loop_hz: bandwidth of the synthesiser's loop.
    """

    level_dbc_hz: float = Field(le=0.0)
    offset_hz: float = Field(default=1e6, gt=0.0)
    loop_hz: float = Field(default=300e3, gt=0.0)


class Leakage(Settings):
    """Transmit signal that reaches the receiver inside the radar, the same at every position.

    Attributes:
        level_db: received over transmitted power.
        path_m: length of its path, as it shows in the range profile (a range bias included).
    """

    level_db: float = Field(le=0.0)
    path_m: float = Field(default=0.0, ge=0.0)


class TableClutter(Settings):
    """An infinite flat surface, parallel to the aperture, below it.

    Its echo is that of the antenna's image: Gamma lambda / (4 pi D) exp(-j k D), D from the transmitter's image to
    the receiver. Objects neither shadow it nor stand in multiple echoes with it.

    Attributes:
        z_m: height of the surface in the radar frame.
        reflection: amplitude reflection coefficient at normal incidence; -1 is a perfect mirror.
    """

    z_m: float
    reflection: float = Field(ge=-1.0, le=1.0)


class RoomClutter(Settings):
    """Static point scatterers at random places in a box, the same for every antenna position.

    Places are uniform in the box and drawn from the seed; every scatterer has the same radar cross-section, with
    neither shadows nor multiple echoes (any radar textbook: many small scatterers make Rayleigh clutter).

    Attributes:
        count: number of scatterers.
        rcs_m2: radar cross-section of each.
        min_m, max_m: opposite corners of the box, radar frame.
    """

    count: int = Field(ge=1, le=10_000)
    rcs_m2: float = Field(gt=0.0)
    min_m: tuple[float, float, float] = Field(strict=False)
    max_m: tuple[float, float, float] = Field(strict=False)

    @model_validator(mode="after")
    def _box(self) -> RoomClutter:
        if not all(low < high for low, high in zip(self.min_m, self.max_m, strict=True)):
            raise RadarError(
                f"RoomClutter: min_m {self.min_m} must lie below max_m {self.max_m} on every axis, in metres"
            )
        return self


class Interferer(Settings):
    """Another radar's chirp, which crosses the receiver's band.

    Mixed with the own chirp it is a chirp of the difference of slopes, present only while its frequency lies
    inside the anti-alias filter, here a Butterworth low-pass of order 8 taken at the instantaneous frequency
    (Brooker 2007, "Mutual interference of millimeter-wave radar systems", IEEE Trans. EMC 49(1)). It arrives from
    broadside, equal at all receivers, with a random phase for every chirp.

    Attributes:
        slope_hz_per_s: slope of its chirp; the own one is bandwidth / (samples / sample rate).
        level_db: power received from it over the own transmitted power.
        filter_hz: half-power frequency of the anti-alias filter, at most half the sample rate.
        crossing_s: when its frequency crosses the own one, from the first sample; None: a random time in
            every chirp.
    """

    slope_hz_per_s: float
    level_db: float
    filter_hz: float = Field(gt=0.0)
    crossing_s: float | None = None


class IqImbalance(Settings):
    """Unequal arms of the quadrature mixer: Q has another gain, and is not quite in quadrature.

    y = alpha x + beta conj(x), alpha = (1 + g exp(j phi)) / 2, beta = (1 - g exp(-j phi)) / 2 (Razavi, RF
    Microelectronics, ch. 4): every echo gets an image at the mirrored beat frequency.

    Attributes:
        gain_db: gain g of Q over I.
        phase_deg: phase error phi.
    """

    gain_db: float = Field(default=0.0, ge=-20.0, le=20.0)
    phase_deg: float = Field(default=0.0, gt=-90.0, lt=90.0)


class DcOffset(Settings):
    """A constant added by mixer and IF amplifier.

    Attributes:
        level_db: its power over the transmitted power.
        phase_deg: its phase: 0 is I, 90 is Q.
    """

    level_db: float
    phase_deg: float = 0.0


class Adc(Settings):
    """Quantisation and saturation of I and Q by equal steps (Bennett 1948: an error of step^2 / 12 in each).

    Attributes:
        bits: two's-complement word length; 16 is the format of recordings.
        full_scale_db: level of a component, as power over transmitted power, that reaches full scale: codes run
            from -2^(bits-1) to 2^(bits-1) - 1 in steps of full scale / 2^(bits-1).
    """

    bits: int = Field(default=16, ge=2, le=16)
    full_scale_db: float

    @property
    def step(self) -> float:
        """One code, in units of h."""
        return float(10.0 ** (self.full_scale_db / 20.0) / 2 ** (self.bits - 1))
