"""What a validation check is given and what it gives back."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.radar import Aperture, Chirp

ComplexArray = NDArray[np.complex128]
FloatArray = NDArray[np.float64]

# TI IWR1443 band of the MITO data set and the full automotive band; 64 samples span the same band as 512.
MITO_BAND = Chirp(77.5001e9, 3.0009e9, 64)
FULL_BAND = Chirp(77.0e9, 4.0e9, 64)
# Range bins of 1.5 m, unambiguous to 24 m, for targets metres away.
FAR_RANGE = Chirp(79.0e9, 0.1e9, 16)


@dataclass(frozen=True)
class CheckResult:
    """One line of the validation table.

    Attributes:
        name: what was set up, with its sizes.
        quantity: what was measured on it.
        measured: its value; the check passes while it is finite and at most the tolerance.
        tolerance: largest value accepted.
        unit: of both.
        reference: where the truth comes from.
        tolerance_source: why the tolerance is what it is.
        mode: mode of the simulator, or "" where it has none.
        seconds: time the check took.
        detail: curves for the figure and figures beside the measured one; arrays and plain numbers.
    """

    name: str
    quantity: str
    measured: float
    tolerance: float
    unit: str
    reference: str
    tolerance_source: str
    mode: str = ""
    seconds: float = 0.0
    detail: Mapping[str, Any] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """True if the measured value is finite and within the tolerance."""
        return bool(np.isfinite(self.measured) and self.measured <= self.tolerance)


@dataclass(frozen=True)
class Trial:
    """The conditions a check runs under.

    Attributes:
        mode: "fast" or "exact".
        quick: True asks for the short form of the check.
        seed: of every random rotation and position.
    """

    mode: str
    quick: bool
    seed: int

    def pick(self, full: int, quick: int, exact: int) -> int:
        """A count for this trial: `exact` in exact mode, which is slow, at most `quick` in quick runs."""
        count = quick if self.quick else full
        return min(count, exact) if self.mode == "exact" else count

    def rng(self, name: str) -> np.random.Generator:
        """A generator of its own for each check, so that leaving one out does not change another."""
        return np.random.default_rng([self.seed, zlib.crc32(name.encode())])

    def simulate(self, targets: Any, chirp: Chirp, aperture: Aperture, **scene: Any) -> ComplexArray:
        """The public simulator with its defaults and this trial's mode; (N, T) in double precision.

        Args:
            targets, chirp, aperture: as for `simulate`.
            **scene: its sheets, box, antenna, polarization, front_end, seed.
        """
        from waveformer.simulator import forward

        measurement = forward.simulate(targets, chirp, aperture, mode=self.mode, **scene)
        return np.asarray(measurement.h, dtype=complex)


def level_db(ratio: ComplexArray) -> FloatArray:
    """Level of an amplitude ratio in decibels."""
    return np.asarray(20 * np.log10(np.maximum(np.abs(ratio), 1e-30)))


def phase_deg(ratio: ComplexArray) -> FloatArray:
    """Phase of a ratio in degrees, -180 .. 180."""
    return np.asarray(np.degrees(np.angle(ratio)))


def placed(offset_m: Any, rotation: Any | None = None) -> FloatArray:
    """Pose (4, 4) from a translation (3,) and a rotation (3, 3)."""
    pose = np.eye(4)
    pose[:3, 3] = offset_m
    if rotation is not None:
        pose[:3, :3] = rotation
    return pose


def worst(values: FloatArray) -> float:
    """Largest magnitude."""
    return float(np.abs(values).max())
