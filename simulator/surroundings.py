"""What every echo passes on its way, whatever it comes from: antennas, sheets and box walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import RadarError
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.radar import finite_vector


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Antennas and occluders of a scene.

    Attributes:
        antenna: gain of both antennas.
        sheets: infinite occluders.
        box: closed box, or None.
        polarization: unit vector of E at both antennas, shape (3,).
    """

    antenna: Antenna = field(default_factory=Antenna.isotropic)
    sheets: Sequence[Sheet] = ()
    box: Box | None = None
    polarization: NDArray[np.float64] | Sequence[float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        if not isinstance(self.antenna, Antenna):
            raise RadarError(f"antenna must be an Antenna, got {self.antenna!r}")
        if not isinstance(self.box, Box | None):
            raise RadarError(f"box must be a Box or None, got {self.box!r}")
        sheets = (self.sheets,) if isinstance(self.sheets, Sheet) else tuple(self.sheets)
        for sheet in sheets:
            if not isinstance(sheet, Sheet):
                raise RadarError(f"sheets must be Sheet objects, got {sheet!r}")
        object.__setattr__(self, "sheets", sheets)
        object.__setattr__(self, "polarization", _unit(self.polarization))

    @property
    def occludes(self) -> bool:
        """True if something stands between radar and object."""
        return bool(self.sheets) or self.box is not None

    def describe(self, frequency_hz: float) -> dict[str, Any]:
        """JSON values for the metadata of a scan, permittivities at the given frequency."""
        assert isinstance(self.polarization, np.ndarray)
        described: dict[str, Any] = {
            "antenna": self.antenna.describe(),
            "polarization": self.polarization.tolist(),
            "sheets": [sheet.describe(frequency_hz) for sheet in self.sheets],
        }
        if self.box is not None:
            described["box"] = self.box.describe(frequency_hz)
        return described


def _unit(value: Any) -> NDArray[np.float64]:
    vector = finite_vector("polarization", value)
    if not np.linalg.norm(vector) > 0:
        raise RadarError("polarization must be a direction, not the zero vector")
    vector = vector / np.linalg.norm(vector)
    vector.setflags(write=False)
    return vector
