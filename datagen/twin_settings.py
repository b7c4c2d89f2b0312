"""What all scans of one twin have in common."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.numerics import EXACT, FAST, Numerics
from waveformer.simulator.radar import Aperture, Chirp

# Coarser than the wavelength, the grating lobes of a bright spot fall onto the object.
MAXIMUM_PITCH_M = 0.004
_ROUNDING_M = 1e-9
# The coarsest quadrature that still counts as exact: the number of rays grows by the square of a finer one.
_NUMERICS = {
    "fast": FAST,
    "exact": EXACT.model_copy(update={"spacing_wavelengths": 1.0 / 3.0, "tolerance": 1e-4}),
}
_MAXIMUM_TESSELLATION = 4
_LOWEST_REFLECTIVITY, _HIGHEST_REFLECTIVITY = 0.15, 1.0


def _mito_chirp() -> Chirp:
    # 64 of MITO's 512 samples over the same band: the same range bins, and 3.2 m without folding
    return Chirp(start_hz=77.5001e9, bandwidth_hz=3.0009e9, num_samples=64)


@dataclass(frozen=True)
class TwinSettings:
    """A twin of MITO's experiment 2; the aperture lies in z = 0, centred at the origin, and looks down.

    Attributes:
        chirp: T samples.
        num_x, num_y: antenna positions along x and y, one receiver at each transmitter.
        spacing_m: pitch of the regular grid, at most 4 mm.
        support_z_m: height of the plane on which objects rest; nothing of it echoes.
        mode: "exact" (visibility of every pair by a ray of its own) or "fast".
        tessellation: how often the mesh is divided irregularly before it is summed.
        seed: of reflectivities, noise, row errors and tessellation.

    Raises:
        RadarError: a value out of range, or a pitch that aliases.
    """

    chirp: Chirp = field(default_factory=_mito_chirp)
    num_x: int = 76
    num_y: int = 101
    spacing_m: float = 0.004
    support_z_m: float = -0.45
    mode: str = "exact"
    tessellation: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        if self.spacing_m > MAXIMUM_PITCH_M + _ROUNDING_M:
            raise RadarError(
                f"a pitch of {self.spacing_m * 1e3:g} mm aliases: its grating lobes fill the background of an image with "
                f"up to a tenth of its peak and hide small objects; use {MAXIMUM_PITCH_M * 1e3:g} mm or less"
            )
        if self.mode not in _NUMERICS:
            raise RadarError(f"unknown mode {self.mode!r}; known: {', '.join(_NUMERICS)}")
        if not (np.isfinite(self.support_z_m) and self.support_z_m < 0):
            raise RadarError(f"support_z_m must lie below the aperture at z = 0, got {self.support_z_m!r}")
        if not 0 <= self.tessellation <= _MAXIMUM_TESSELLATION:
            raise RadarError(
                f"tessellation must be 0 .. {_MAXIMUM_TESSELLATION} (each multiplies the faces by 4), got "
                f"{self.tessellation!r}"
            )
        _ = self.aperture, self.generator("check", "")

    @property
    def aperture(self) -> Aperture:
        """The antennas, row by row, x fastest."""
        return Aperture.planar_grid(self.num_x, self.num_y, self.spacing_m)

    @property
    def numerics(self) -> Numerics:
        """Kernel settings of the mode."""
        return _NUMERICS[self.mode]

    def generator(self, purpose: str, object_id: str) -> np.random.Generator:
        """Random numbers of one object for one purpose, whatever other objects there are."""
        return generator(self.seed, f"twin {purpose} {object_id}")

    def reflectivity(self, object_id: str) -> float:
        """Amplitude of an object's echo over that of a perfect conductor of its shape, 0.15 .. 1."""
        rng = self.generator("reflectivity", object_id)
        return float(rng.uniform(_LOWEST_REFLECTIVITY, _HIGHEST_REFLECTIVITY))

    def front_end_seed(self, object_id: str) -> int:
        """Seed of noise and row errors: the same in all conditions, so that they compare pair by pair."""
        return int(self.generator("front end", object_id).integers(2**31))

    def describe(self) -> dict[str, Any]:
        """Everything here as JSON values; two twins with equal ones have equal scans."""
        return {**dataclasses.asdict(self), "numerics": self.numerics.model_dump()}
