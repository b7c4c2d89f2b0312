"""The conditions under which a twin is recorded: what the radar adds, and what stands in the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S

_SHEET_Z_M = -0.26
_SHEET_HZ = 79e9

# Object alone, or behind which sheet; and whether the antennas were displaced, and how much.
EchoKey = tuple[tuple[float, complex | str] | None, float]


@dataclass(frozen=True)
class Condition:
    """One way to record an object.

    Attributes:
        name: of the folder.
        front_end: what the radar does to the ideal signal.
        sheet: a sheet between radar and object, with its own echo.
    """

    name: str
    front_end: FrontEnd = field(default_factory=FrontEnd)
    sheet: Sheet | None = None

    @property
    def echo_key(self) -> EchoKey:
        """Conditions with equal keys have the same echo of the object: they differ in the front end only."""
        occluder = None if self.sheet is None else (self.sheet.thickness_m, self.sheet.permittivity)
        return occluder, self.front_end.row_depth_error_m

    def describe(self, frequency_hz: float) -> dict[str, Any]:
        """JSON values, the permittivity at the given frequency."""
        sheet = None if self.sheet is None else self.sheet.describe(frequency_hz)
        return {"name": self.name, "front_end": self.front_end.describe(), "sheet": sheet}


def quarter_wave_sheet(reflection: float) -> Sheet:
    """A level, lossless sheet that sends back an amplitude of `reflection`, 0.26 m below the aperture.

    A quarter of a wavelength thick, where |Gamma| = (eps - 1) / (eps + 1) is at its maximum and so hardly varies over
    the band (Born & Wolf 1.6.4): 0.1 takes eps 1.222 and 0.858 mm, 0.05 takes eps 1.105 and 0.902 mm.
    """
    permittivity = (1.0 + reflection) / (1.0 - reflection)
    thickness_m = SPEED_OF_LIGHT_M_PER_S / _SHEET_HZ / 4.0 / permittivity**0.5
    return Sheet((0.0, 0.0, _SHEET_Z_M), (0.0, 0.0, 1.0), thickness_m, complex(permittivity), echo=True)


CONDITIONS = {
    condition.name: condition
    for condition in (
        Condition("clean"),
        Condition("m40", FrontEnd(mirror_snr_db=40.0)),
        Condition("m30", FrontEnd(mirror_snr_db=30.0)),
        Condition("rows", FrontEnd(row_depth_error_m=3e-4, mirror_snr_db=50.0)),
        Condition("sheet", FrontEnd(mirror_snr_db=46.0), quarter_wave_sheet(0.1)),
        Condition("box", FrontEnd(row_depth_error_m=2e-4, mirror_snr_db=40.0), quarter_wave_sheet(0.05)),
    )
}
# The conditions whose reconstructions are as good as those of MITO's recordings with and without line of sight.
ALIASES = {"los": "clean", "nlos": "box"}


def resolve_conditions(names: Sequence[str]) -> list[Condition]:
    """The conditions of these names, each once, in the order of `CONDITIONS`.

    Raises:
        RadarError: an unknown name, or none at all.
    """
    for name in names:
        if name not in CONDITIONS and name not in ALIASES:
            aliases = ", ".join(f"{alias} = {meant}" for alias, meant in ALIASES.items())
            raise RadarError(f"unknown condition {name!r}; known: {', '.join(CONDITIONS)}, {aliases}")
    if not names:
        raise RadarError(f"no condition given; known: {', '.join(CONDITIONS)}")
    wanted = {ALIASES.get(name, name) for name in names}
    return [condition for condition in CONDITIONS.values() if condition.name in wanted]
