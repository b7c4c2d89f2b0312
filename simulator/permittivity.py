"""Relative permittivity of everyday matter over frequency, eps = eps' - j eps'' (time factor exp(+j omega t))."""

from __future__ import annotations

import cmath
from dataclasses import dataclass

from waveformer.simulator.errors import RadarError

# eps'' = conductivity / (2 pi f eps_0) = 17.98 S/m GHz (ITU-R P.2040-3, eq. 12)
_CONDUCTIVITY_TO_LOSS = 17.98


@dataclass(frozen=True)
class Permittivity:
    """eps' = real * f^real_exponent and conductivity = conductivity * f^conductivity_exponent, f in GHz.

    The form of ITU-R P.2040-3, eq. 28 and 29; a constant permittivity has `loss` instead of a conductivity.

    Attributes:
        real, real_exponent: of eps'.
        conductivity_s_per_m, conductivity_exponent: of the conductivity.
        loss: constant part of eps''.
    """

    real: float
    real_exponent: float = 0.0
    conductivity_s_per_m: float = 0.0
    conductivity_exponent: float = 0.0
    loss: float = 0.0

    @classmethod
    def constant(cls, value: complex) -> Permittivity:
        """A permittivity that does not depend on frequency."""
        try:
            number = complex(value)
        except (TypeError, ValueError):
            number = complex("nan")
        if not cmath.isfinite(number) or number.real < 1.0 or number.imag > 0.0:
            raise RadarError(
                f"permittivity must be eps' - j eps'' with eps' >= 1 and eps'' >= 0 (time factor exp(+j omega t), "
                f"so 1.5-0.05j), got {value!r}"
            )
        return cls(real=number.real, loss=-number.imag)

    def at(self, frequency_hz: float) -> complex:
        """The complex value eps' - j eps'' at a frequency."""
        gigahertz = frequency_hz / 1e9
        conductivity = self.conductivity_s_per_m * gigahertz**self.conductivity_exponent
        return complex(
            self.real * gigahertz**self.real_exponent,
            -self.loss - _CONDUCTIVITY_TO_LOSS * conductivity / gigahertz,
        )


# ITU-R P.2040-3, table 3, where the source says so.
PERMITTIVITIES: dict[str, Permittivity] = {
    "wood": Permittivity(1.99, 0.0, 0.0047, 1.0718),  # ITU-R P.2040-3, 0.001 - 100 GHz
    "glass": Permittivity(6.31, 0.0, 0.0036, 1.3394),  # ITU-R P.2040-3, 0.1 - 100 GHz
    "metal": Permittivity(1.0, 0.0, 1e7, 0.0),  # ITU-R P.2040-3, 1 - 100 GHz
    "cardboard": Permittivity.constant(1.5 - 0.05j),
}


def lookup_permittivity(name: str) -> Permittivity:
    """The permittivity of a named material; raises RadarError naming the known ones."""
    if name not in PERMITTIVITIES:
        raise RadarError(f"unknown material {name!r}; known: {', '.join(sorted(PERMITTIVITIES))}")
    return PERMITTIVITIES[name]
