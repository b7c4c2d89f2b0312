"""The radar: its chirp and the positions of its antennas.

The one statement of the phase sign: time factor exp(+j omega t), propagation exp(-j k r), so the
dechirped sample t of a point at range R is ``a * exp(-j 2 pi f_t tau)``, tau = (R_tx + R_rx) / c.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.presets import APERTURE_PRESETS, CHIRP_PRESETS, RASTER_PRESETS, lookup_preset

SPEED_OF_LIGHT_M_PER_S = 299_792_458.0


@dataclass(frozen=True)
class Chirp:
    """A linear FMCW chirp, sampled after dechirping.

    Attributes:
        start_hz: frequency of sample 0.
        bandwidth_hz: swept bandwidth; sample t sees ``start_hz + t * bandwidth_hz / num_samples``
            (end point excluded).
        num_samples: T, complex samples per chirp.
    """

    start_hz: float
    bandwidth_hz: float
    num_samples: int

    def __post_init__(self) -> None:
        for name in ("start_hz", "bandwidth_hz"):
            value = getattr(self, name)
            is_number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(
                value, bool
            )
            if not (is_number and np.isfinite(value) and value > 0):
                raise RadarError(f"chirp {name} must be a positive number of hertz, got {value!r}")
            object.__setattr__(self, name, float(value))
        samples = self.num_samples
        if isinstance(samples, bool) or not isinstance(samples, (int, np.integer)) or samples < 2:
            raise RadarError(f"chirp num_samples must be an integer of at least 2, got {samples!r}")
        if samples > 1 << 20:
            raise RadarError(f"chirp num_samples of {samples} is more than 2^20: no radar samples so")
        if not 1e8 <= self.start_hz <= 1e12:
            raise RadarError(
                f"chirp start_hz {self.start_hz:g} lies outside 0.1 GHz .. 1 THz; frequencies are in hertz (77 GHz is 77e9)"
            )
        if self.bandwidth_hz > self.start_hz:
            raise RadarError(
                f"chirp bandwidth_hz {self.bandwidth_hz:g} exceeds start_hz {self.start_hz:g}; frequencies are in hertz"
            )

    @classmethod
    def from_preset(cls, name: str) -> Chirp:
        """The chirp of a named radar (see ``waveformer.simulator.presets``)."""
        return cls(**lookup_preset("radar", CHIRP_PRESETS, name))

    @cached_property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Frequency of every sample, shape (T,)."""
        steps = np.arange(self.num_samples, dtype=np.float64)
        frequencies = self.start_hz + steps * (self.bandwidth_hz / self.num_samples)
        frequencies.setflags(write=False)
        return frequencies

    @property
    def wavelengths_m(self) -> NDArray[np.float64]:
        """Wavelength of every sample, shape (T,)."""
        return np.asarray(SPEED_OF_LIGHT_M_PER_S / self.frequencies_hz)

    @property
    def center_hz(self) -> float:
        """Centre of the sampled band, the carrier of every kernel."""
        return float(0.5 * (self.frequencies_hz[0] + self.frequencies_hz[-1]))

    @property
    def range_bin_m(self) -> float:
        """Range resolution c / (2 B)."""
        return SPEED_OF_LIGHT_M_PER_S / (2.0 * self.bandwidth_hz)

    @property
    def unambiguous_range_m(self) -> float:
        """Range beyond which an echo folds back, T * c / (2 B)."""
        return self.num_samples * self.range_bin_m


@dataclass(frozen=True, eq=False)
class Aperture:
    """Positions of the transmit and receive antenna of every row of H.

    Attributes:
        tx_m: transmitters, shape (N, 3), radar frame (z up, looking down).
        rx_m: receivers, shape (N, 3); None means monostatic (receiver at the transmitter).
    """

    tx_m: NDArray[np.float64]
    rx_m: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "tx_m", _positions("tx_m", self.tx_m))
        if self.rx_m is not None:
            object.__setattr__(self, "rx_m", _positions("rx_m", self.rx_m))
            if self.rx_m.shape != self.tx_m.shape:
                raise RadarError(
                    f"aperture rx_m {self.rx_m.shape} must pair row by row with tx_m {self.tx_m.shape}"
                )

    def __len__(self) -> int:
        return len(self.tx_m)

    @property
    def is_monostatic(self) -> bool:
        """True if every receiver is its transmitter."""
        return self.rx_m is None

    @property
    def receivers_m(self) -> NDArray[np.float64]:
        """Receivers, shape (N, 3), also for a monostatic aperture."""
        return self.tx_m if self.rx_m is None else self.rx_m

    @classmethod
    def planar_grid(
        cls,
        num_x: int,
        num_y: int,
        spacing_m: float | tuple[float, float],
        *,
        center_m: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Aperture:
        """A regular grid of positions in a plane of constant z, row by row.

        Args:
            num_x, num_y: positions along x and y.
            spacing_m: pitch, one number or (along x, along y).
            center_m: centre of the grid, shape (3,).

        Returns:
            Aperture of N = num_x * num_y positions; x runs fastest.
        """
        pitch = (
            finite_vector("aperture spacing_m", spacing_m, 2)
            if np.ndim(spacing_m)
            else np.full(2, spacing_m, dtype=float)
        )
        pitch_x_m, pitch_y_m = pitch
        whole = all(isinstance(count, (int, np.integer)) for count in (num_x, num_y))
        if not whole or num_x < 1 or num_y < 1 or not (np.isfinite(pitch).all() and (pitch > 0).all()):
            raise RadarError(
                f"aperture grid needs positive counts and spacing, got {num_x} x {num_y} at {spacing_m} m"
            )
        x_m = (np.arange(num_x) - (num_x - 1) / 2) * pitch_x_m
        y_m = (np.arange(num_y) - (num_y - 1) / 2) * pitch_y_m
        grid_y, grid_x = np.meshgrid(y_m, x_m, indexing="ij")
        positions = np.stack([grid_x, grid_y, np.zeros_like(grid_x)], axis=-1).reshape(-1, 3)
        return cls(positions + finite_vector("aperture center_m", center_m, 3))

    @classmethod
    def raster_rows(
        cls,
        row_length_m: float,
        num_rows: int,
        *,
        step_m: float,
        row_spacing_m: float,
        center_m: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Aperture:
        """A robot's raster scan: parallel rows along x, every second one backwards.

        Args:
            row_length_m: length of a row.
            num_rows: rows along y.
            step_m: distance of neighbouring positions in a row.
            row_spacing_m: distance of neighbouring rows.
            center_m: centre of the scan, shape (3,).
        """
        lengths = np.array([step_m, row_length_m, row_spacing_m], dtype=float)
        if not (
            np.isfinite(lengths).all() and lengths.min() > 0 and row_length_m >= step_m and num_rows >= 1
        ):
            raise RadarError(
                f"raster needs row_length_m >= step_m > 0, row_spacing_m > 0 and num_rows >= 1, got "
                f"{row_length_m}, {step_m}, {row_spacing_m}, {num_rows}"
            )
        per_row = int(np.floor(row_length_m / step_m + 1e-9)) + 1
        x_m = (np.arange(per_row) - (per_row - 1) / 2) * step_m
        y_m = (np.arange(num_rows) - (num_rows - 1) / 2) * row_spacing_m
        rows = [
            np.stack([x_m if i % 2 == 0 else x_m[::-1], np.full(per_row, y), np.zeros(per_row)], axis=1)
            for i, y in enumerate(y_m)
        ]
        return cls(np.concatenate(rows) + finite_vector("aperture center_m", center_m, 3))

    @classmethod
    def from_preset(cls, name: str) -> Aperture:
        """A named aperture, a grid or a raster scan (see ``waveformer.simulator.presets``).

        Raises:
            RadarError: unknown name; the known ones are listed.
        """
        arguments = lookup_preset("aperture", APERTURE_PRESETS | RASTER_PRESETS, name)
        return cls.raster_rows(**arguments) if name in RASTER_PRESETS else cls.planar_grid(**arguments)


def finite_vector(name: str, value: Any, size: int = 3) -> NDArray[np.float64]:
    """A read-only vector of finite numbers; raises RadarError with its name."""
    try:
        vector = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.empty(0)
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise RadarError(f"{name} must be {size} finite numbers, got {value!r}")
    vector.setflags(write=False)
    return vector


def _positions(name: str, value: Any) -> NDArray[np.float64]:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise RadarError(f"aperture {name} must be numbers of shape (N, 3) in metres") from None
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
        raise RadarError(f"aperture {name} must have shape (N, 3) with N >= 1, got {array.shape}")
    if not np.isfinite(array).all():
        raise RadarError(f"aperture {name} holds {int((~np.isfinite(array)).sum())} non-finite coordinates")
    array.setflags(write=False)
    return array
