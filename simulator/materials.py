"""What surfaces are made of: perfect conductors, dielectrics, thin walls, and a small cited table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from waveformer.simulator.errors import RadarError
from waveformer.simulator.permittivity import Permittivity, lookup_permittivity


@dataclass(frozen=True)
class Material:
    """How a surface reflects.

    Attributes:
        name: for reports.
        permittivity: relative permittivity over frequency; None for a perfect conductor.
        thickness_m: thickness of a thin wall (a slab with air behind it); None for a half space: a body
            so lossy or so thick that its back wall's echo is left out.
        roughness_m: rms height of the surface; the coherent echo loses exp(-(2 k roughness cos)^2) in power
            (Ament 1953).
    """

    name: str
    permittivity: Permittivity | None
    thickness_m: float | None = None
    roughness_m: float = 0.0

    def __post_init__(self) -> None:
        if self.thickness_m is not None and not (
            math.isfinite(self.thickness_m) and 0.0 < self.thickness_m <= 1.0
        ):
            raise RadarError(f"material thickness_m must lie in 0 .. 1 m, got {self.thickness_m!r}")
        if not (math.isfinite(self.roughness_m) and 0.0 <= self.roughness_m <= 0.01):
            raise RadarError(f"material roughness_m must lie in 0 .. 0.01 m, got {self.roughness_m!r}")

    @classmethod
    def pec(cls, roughness_m: float = 0.0) -> Material:
        """A perfect electric conductor: Gamma = -1 where it is smooth."""
        return cls("pec", None, None, roughness_m)

    @classmethod
    def dielectric(
        cls, permittivity: complex, thickness_m: float | None = None, roughness_m: float = 0.0
    ) -> Material:
        """A dielectric of constant relative permittivity eps' - j eps''.

        Args:
            permittivity: relative permittivity; its imaginary part is zero or negative.
            thickness_m: thickness of a thin wall; None for a half space.
            roughness_m: rms height.
        """
        return cls("dielectric", Permittivity.constant(permittivity), thickness_m, roughness_m)

    @classmethod
    def named(cls, name: str, thickness_m: float | None = None, roughness_m: float = 0.0) -> Material:
        """A material of the table in `permittivity`; raises RadarError naming the known ones."""
        return cls(name, lookup_permittivity(name), thickness_m, roughness_m)

    @property
    def is_conductor(self) -> bool:
        """True for a perfect conductor."""
        return self.permittivity is None

    def describe(self, frequency_hz: float) -> dict[str, Any]:
        """JSON values for the metadata of a scan, the permittivity at the given frequency."""
        described: dict[str, Any] = {"name": self.name, "roughness_m": self.roughness_m}
        if self.permittivity is not None:
            value = self.permittivity.at(frequency_hz)
            described |= {"permittivity": [value.real, value.imag], "thickness_m": self.thickness_m}
        return described
