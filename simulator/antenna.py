"""Antenna patterns: how strongly an antenna sends or receives in each direction.

A direction is the unit vector u from the scene point to the antenna. The radar looks down, so broadside is
u = +z, and an antenna sees nothing behind itself, u_z <= 0. The angles of the two principal planes are
theta_x = atan2(u_x, u_z) and theta_y = atan2(u_y, u_z).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.presets import lookup_preset

# Two measured cuts of one antenna agree at broadside to the accuracy of a gain measurement.
_LARGEST_BROADSIDE_DIFFERENCE_DB = 0.5

ANTENNA_PRESETS: dict[str, dict[str, Any]] = {
    # TI IWR1443BOOST, etched antennas (TI SWRU518, "PCB Antenna"): peak gain 10.5 dBi over 76-81 GHz, half power
    # at +-28 degrees in the horizontal and +-14 degrees in the vertical plane at 78 GHz. The four receivers lie in
    # a row in the horizontal plane. MITO has that row along x (its "rx offset x"), so x is the wide plane.
    "iwr1443": {"gain_dbi": 10.5, "beamwidth_x_deg": 56.0, "beamwidth_y_deg": 28.0},
}


@dataclass(frozen=True, eq=False)
class AntennaCuts:
    """Both principal planes of a pattern, sampled at equal steps.

    The amplitude in any direction before the antenna is
    ``amplitude_x(theta_x) * amplitude_y(theta_y) / broadside``.

    Attributes:
        step_deg: angle between neighbouring samples; the first is at -90 degrees, the last at +90.
        amplitude_x: square root of the power gain over theta_x at theta_y = 0, shape (K,).
        amplitude_y: the same over theta_y at theta_x = 0, shape (K,).
        broadside: amplitude at broadside.
    """

    step_deg: float
    amplitude_x: NDArray[np.float64]
    amplitude_y: NDArray[np.float64]
    broadside: float


@dataclass(frozen=True, eq=False)
class Antenna:
    """The gain pattern shared by transmit and receive antennas.

    Made by `isotropic`, `cosine_power`, `table` or `from_preset`.

    Attributes:
        gain_dbi: power gain at broadside.
        beamwidths_deg: full half-power widths in the x and y plane of a cosine-power pattern, or None.
        angles_deg: angles of a table of cuts, increasing, shape (K,), or None.
        gain_x_dbi, gain_y_dbi: power gain of both cuts at these angles, shape (K,), or None.
    """

    gain_dbi: float
    beamwidths_deg: tuple[float, float] | None = None
    angles_deg: NDArray[np.float64] | None = None
    gain_x_dbi: NDArray[np.float64] | None = None
    gain_y_dbi: NDArray[np.float64] | None = None

    @classmethod
    def isotropic(cls, gain_dbi: float = 0.0) -> Antenna:
        """The same gain in every direction, also behind."""
        return cls(_finite("gain_dbi", gain_dbi))

    @classmethod
    def cosine_power(cls, gain_dbi: float, beamwidth_x_deg: float, beamwidth_y_deg: float) -> Antenna:
        """Power gain G0 cos(theta_x)^n_x cos(theta_y)^n_y, nothing behind (Balanis, Antenna Theory, ch. 2).

        The exponents follow from the full half-power widths, the numbers a data sheet gives:
        cos(width / 2)^n = 1/2.

        Args:
            gain_dbi: power gain at broadside; not derived from the widths, since it includes the losses.
            beamwidth_x_deg, beamwidth_y_deg: full half-power widths of the two planes, below 180.

        Raises:
            RadarError: a width outside 0 .. 180 degrees.
        """
        widths = (_finite("beamwidth_x_deg", beamwidth_x_deg), _finite("beamwidth_y_deg", beamwidth_y_deg))
        if not all(0.0 < width < 180.0 for width in widths):
            raise RadarError(
                f"antenna beamwidths must lie between 0 and 180 degrees, got {beamwidth_x_deg!r}, {beamwidth_y_deg!r}"
            )
        return cls(_finite("gain_dbi", gain_dbi), beamwidths_deg=widths)

    @classmethod
    def table(cls, angles_deg: ArrayLike, gain_x_dbi: ArrayLike, gain_y_dbi: ArrayLike) -> Antenna:
        """Two measured principal-plane cuts; G = G_x + G_y - G(broadside), in dB.

        Between the angles the gain in dB is linear; beyond the last one it keeps its value up to 90 degrees.

        Args:
            angles_deg: increasing, from below to above zero, within -90 .. 90, shape (K,), K >= 2.
            gain_x_dbi: gain over theta_x at theta_y = 0, shape (K,).
            gain_y_dbi: gain over theta_y at theta_x = 0, shape (K,).

        Raises:
            RadarError: shapes do not fit, angles are out of order, or the cuts differ at broadside.
        """
        angles = _row("angles_deg", angles_deg)
        cuts = _row("gain_x_dbi", gain_x_dbi), _row("gain_y_dbi", gain_y_dbi)
        if len(angles) < 2 or any(cut.shape != angles.shape for cut in cuts):
            raise RadarError(
                f"antenna table needs two or more angles and as many gains in both planes, got {len(angles)} angles, "
                f"{len(cuts[0])} and {len(cuts[1])} gains"
            )
        if not ((np.diff(angles) > 0).all() and -90.0 <= angles[0] <= 0.0 <= angles[-1] <= 90.0):
            raise RadarError("antenna table angles_deg must increase from -90 .. 0 to 0 .. 90 degrees")
        at_zero = [float(np.interp(0.0, angles, cut)) for cut in cuts]
        if abs(at_zero[0] - at_zero[1]) > _LARGEST_BROADSIDE_DIFFERENCE_DB:
            raise RadarError(
                f"antenna table: the cuts give {at_zero[0]:.2f} and {at_zero[1]:.2f} dBi at broadside, where they are "
                "one direction; give both the same peak gain"
            )
        return cls(sum(at_zero) / 2, angles_deg=angles, gain_x_dbi=cuts[0], gain_y_dbi=cuts[1])

    @classmethod
    def from_preset(cls, name: str) -> Antenna:
        """The antenna of a named radar board (`ANTENNA_PRESETS`)."""
        return cls.cosine_power(**lookup_preset("antenna", ANTENNA_PRESETS, name))

    @property
    def is_isotropic(self) -> bool:
        """True if the gain does not depend on direction."""
        return self.beamwidths_deg is None and self.angles_deg is None

    @property
    def broadside_amplitude(self) -> float:
        """Square root of the power gain at broadside."""
        return float(10.0 ** (self.gain_dbi / 20.0))

    def amplitude(self, direction: ArrayLike) -> NDArray[np.float64]:
        """Square root of the power gain towards scene points.

        Args:
            direction: vectors from the scene point to the antenna, of any length, shape (..., 3).

        Returns:
            Amplitudes, shape (...).
        """
        u = np.asarray(direction, dtype=np.float64)
        if self.is_isotropic:
            return np.full(u.shape[:-1], self.broadside_amplitude)
        theta_x, theta_y = np.arctan2(u[..., 0], u[..., 2]), np.arctan2(u[..., 1], u[..., 2])
        both = self._cut(theta_x, 0) * self._cut(theta_y, 1) / self.broadside_amplitude
        return np.where(u[..., 2] > 0.0, both, 0.0)

    def cuts(self, step_deg: float = 0.25) -> AntennaCuts:
        """Both principal planes from -90 to +90 degrees, for a kernel that interpolates linearly.

        At 0.25 degrees linear interpolation errs by less than 1e-4 of the broadside amplitude, for half-power
        widths of 25 degrees or more.

        Raises:
            RadarError: 180 degrees are not a whole number of steps.
        """
        count = round(180.0 / step_deg) if math.isfinite(step_deg) and step_deg > 0 else 0
        if count < 2 or abs(count * step_deg - 180.0) > 1e-6:
            raise RadarError(
                f"antenna cuts: 180 degrees must be a whole number of steps, got {step_deg!r} degrees"
            )
        angles = np.radians(np.linspace(-90.0, 90.0, count + 1))
        return AntennaCuts(
            180.0 / count, self._cut(angles, 0), self._cut(angles, 1), self.broadside_amplitude
        )

    def describe(self) -> dict[str, Any]:
        """Plain JSON values for the metadata of a measurement."""
        if self.is_isotropic:
            return {"pattern": "isotropic", "gain_dbi": self.gain_dbi}
        if self.beamwidths_deg is not None:
            widths = list(self.beamwidths_deg)
            return {"pattern": "cosine_power", "gain_dbi": self.gain_dbi, "beamwidths_deg": widths}
        names = ("angles_deg", "gain_x_dbi", "gain_y_dbi")
        return {"pattern": "table", "gain_dbi": self.gain_dbi} | {
            name: getattr(self, name).tolist() for name in names
        }

    def _cut(self, theta: NDArray[np.float64], plane: int) -> NDArray[np.float64]:
        """Amplitude over the angle in one principal plane (0: x, 1: y), |theta| <= 90 degrees."""
        if self.beamwidths_deg is not None:
            half = math.radians(self.beamwidths_deg[plane]) / 2
            exponent = math.log(0.5) / math.log(math.cos(half))
            return np.asarray(self.broadside_amplitude * np.maximum(np.cos(theta), 0.0) ** (exponent / 2))
        gains = self.gain_x_dbi if plane == 0 else self.gain_y_dbi
        if self.angles_deg is None or gains is None:
            return np.full(theta.shape, self.broadside_amplitude)
        # The mean of two cuts that differ at broadside is the gain there, so each is shifted to meet it.
        shift = self.gain_dbi - float(np.interp(0.0, self.angles_deg, gains))
        return np.asarray(10.0 ** ((np.interp(np.degrees(theta), self.angles_deg, gains) + shift) / 20.0))


def _finite(name: str, value: Any) -> float:
    is_number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value):
        raise RadarError(f"antenna {name} must be a finite number, got {value!r}")
    return float(value)


def _row(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        row = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        row = np.empty((0, 0))
    if row.ndim != 1 or not np.isfinite(row).all():
        raise RadarError(f"antenna table {name} must be a list of finite numbers")
    row.setflags(write=False)
    return row
