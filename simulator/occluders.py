"""What stands between radar and object: flat sheets and a closed box, both of uniform dielectric walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.radar import finite_vector


@dataclass(frozen=True, eq=False)
class Sheet:
    """An infinite flat sheet: cardboard, cloth, foam.

    Attributes:
        point_m: a point of the face towards the radar, shape (3,).
        normal: normal of the sheet, either way round, shape (3,); made a unit vector.
        thickness_m: of the sheet.
        permittivity: complex eps' - j eps'', or the name of a material.
        echo: whether the sheet's own reflection is added.
    """

    point_m: NDArray[np.float64] | Sequence[float]
    normal: NDArray[np.float64] | Sequence[float]
    thickness_m: float
    permittivity: complex | str
    echo: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "point_m", finite_vector("sheet point_m", self.point_m))
        normal = finite_vector("sheet normal", self.normal)
        if not np.linalg.norm(normal) > 0:
            raise RadarError("sheet normal must not be the zero vector")
        object.__setattr__(self, "normal", normal / np.linalg.norm(normal))
        object.__setattr__(self, "thickness_m", _thickness("sheet", self.thickness_m))
        _ = self.material

    @cached_property
    def material(self) -> Material:
        """The slab that the sheet is."""
        return wall_material(self.permittivity, self.thickness_m)

    def describe(self, frequency_hz: float) -> dict[str, Any]:
        """JSON values for the metadata of a scan."""
        return {
            "point_m": np.asarray(self.point_m).tolist(),
            "normal": np.asarray(self.normal).tolist(),
            "echo": self.echo,
            **self.material.describe(frequency_hz),
        }


@dataclass(frozen=True, eq=False)
class Box:
    """A closed box of six finite walls around the object, edges along the axes.

    Attributes:
        min_m, max_m: opposite outer corners, shape (3,).
        thickness_m: of the walls, which lie inside the outer corners.
        permittivity: complex eps' - j eps'', or the name of a material.
    """

    min_m: NDArray[np.float64] | Sequence[float]
    max_m: NDArray[np.float64] | Sequence[float]
    thickness_m: float
    permittivity: complex | str

    def __post_init__(self) -> None:
        low, high = finite_vector("box min_m", self.min_m), finite_vector("box max_m", self.max_m)
        object.__setattr__(self, "min_m", low)
        object.__setattr__(self, "max_m", high)
        object.__setattr__(self, "thickness_m", _thickness("box", self.thickness_m))
        if not (high - low > 2.0 * self.thickness_m).all():
            raise RadarError(
                f"box from {low.tolist()} to {high.tolist()} m has no inside: min_m must lie below max_m on every "
                f"axis, by more than two walls of {self.thickness_m:g} m"
            )
        _ = self.material

    @cached_property
    def material(self) -> Material:
        """The slab that a wall is."""
        return wall_material(self.permittivity, self.thickness_m)

    @property
    def middle_min_m(self) -> NDArray[np.float64]:
        """Lower corner of the walls' middle surfaces: what lies beyond them is outside, shape (3,)."""
        return np.asarray(self.min_m) + 0.5 * self.thickness_m

    @property
    def middle_max_m(self) -> NDArray[np.float64]:
        """Upper corner of the same, shape (3,)."""
        return np.asarray(self.max_m) - 0.5 * self.thickness_m

    def describe(self, frequency_hz: float) -> dict[str, Any]:
        """JSON values for the metadata of a scan."""
        return {
            "min_m": np.asarray(self.min_m).tolist(),
            "max_m": np.asarray(self.max_m).tolist(),
            **self.material.describe(frequency_hz),
        }


def wall_material(permittivity: complex | str, thickness_m: float) -> Material:
    """A slab of a named material or of a given permittivity."""
    if isinstance(permittivity, str):
        return Material.named(permittivity, thickness_m)
    return Material.dielectric(permittivity, thickness_m)


def _thickness(kind: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise RadarError(f"{kind} thickness_m must be a number of metres, got {value!r}")
    if not (math.isfinite(value) and 0.0 < value <= 0.2):
        raise RadarError(f"{kind} thickness_m must lie in 0 .. 0.2 m, got {value!r}")
    return float(value)
