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


# Frequencies are those of the measurement; outside them the value is carried on unchanged.
# ABS, 11 GHz, loss tangent 0.008: Riddle, Baker-Jarvis, Krupka, IEEE Trans. Microw. Theory Tech. 51 (2003) 727
_ABS = Permittivity.constant(2.7 - 0.022j)

PERMITTIVITIES: dict[str, Permittivity] = {
    "metal": Permittivity(1.0, 0.0, 1e7, 0.0),  # ITU-R P.2040-3, table 3, 1 - 100 GHz
    "wood": Permittivity(1.99, 0.0, 0.0047, 1.0718),  # ITU-R P.2040-3, table 3, 0.001 - 100 GHz
    "glass": Permittivity(6.31, 0.0, 0.0036, 1.3394),  # ITU-R P.2040-3, table 3, 0.1 - 100 GHz
    "acrylic": Permittivity(2.58, 0.0, 0.0001, 1.6524),  # ITU-R P.2040-3, table 3, 110 - 330 GHz
    "abs": _ABS,
    "plastic": _ABS,  # as ABS: between acrylic (2.58) and nylon (3.0, Riddle et al. 2003)
    # No measurement near 77 GHz was found. Corrugated board is wood fibre of about half the density of wood:
    # ITU-R P.2040-3, table 3, wood (0.001 - 100 GHz) mixed by volume with as much air.
    "cardboard": Permittivity(1.495, 0.0, 0.00235, 1.0718),
    # Polystyrene foam, 0.2 - 4 THz: index 1.017 - 1.022; loss below 1.5 / cm at 4 THz, taken as an upper bound of
    # the loss tangent: Zhao et al., J. Opt. Soc. Am. B 19 (2002) 1476
    "foam": Permittivity.constant(1.04 - 0.0018j),
    # Silicone rubber (PDMS), 40 GHz, loss tangent 0.048: Sharma, Gupta, Dankov, AEU Int. J. Electron. Commun.
    # 127 (2020) 153455; the abstract was read, not the tables
    "rubber": Permittivity.constant(2.64 - 0.127j),
    # Alumina, loss tangent 0.0005, typical value for 77 GHz radar covers: Texas Instruments SWRA705 (2021), quoted
    # without its table at hand
    "ceramic": Permittivity.constant(9.8 - 0.0049j),
}


def lookup_permittivity(name: str) -> Permittivity:
    """The permittivity of a named material; raises RadarError naming the known ones."""
    if name not in PERMITTIVITIES:
        raise RadarError(f"unknown material {name!r}; known: {', '.join(sorted(PERMITTIVITIES))}")
    return PERMITTIVITIES[name]
