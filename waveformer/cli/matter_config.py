"""Materials, sheets and boxes as users write them: sections of a file, or one line of text.

A line names the material first and settings after it, with the keys of the file: ``cardboard,z_m=-0.2,thickness_m=0.004``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from pydantic import model_validator

from waveformer.config import Config

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from waveformer.simulator.materials import Material
    from waveformer.simulator.occluders import Box, Sheet

Vector = tuple[float, float, float]

# Single-wall corrugated board of C flute is about 4 mm thick.
_BOARD_M = 0.004
_MARGIN_M = 0.05


def from_text(first_key: str) -> Callable[[Any], Any]:
    """A validator that turns a line of text into the section it stands for.

    Args:
        first_key: key of the value that stands first, without its name.

    Returns:
        A function that leaves sections as they are.
    """

    def convert(value: Any) -> Any:
        if not isinstance(value, str):
            return with_tuples(value)
        first, *others = value.split(",")
        section: dict[str, Any] = {first_key: first.strip()}
        for item in others:
            key, equals, text = item.partition("=")
            if not equals:
                raise ValueError(
                    f"{item.strip()!r} has no value; expected {first_key.upper()},key=value,... as in "
                    "cardboard,thickness_m=0.004"
                )
            section[key.strip()] = _plain(text.strip())
        return section

    return convert


def with_tuples(value: Any) -> Any:
    """A section with tuples for lists: past a validator it is no JSON any more, and a tuple is only what is a tuple."""
    if not isinstance(value, dict):
        return value
    return {key: tuple(item) if isinstance(item, list) else item for key, item in value.items()}


class MaterialConfig(Config):
    """What the objects are made of.

    Attributes:
        name: "pec", a material of the table, or a permittivity such as "2.6-0.02j".
        thickness_m: of a thin wall with air behind it; None for a massive body.
        roughness_m: rms height of the surface.
    """

    name: str = "pec"
    thickness_m: float | None = None
    roughness_m: float = 0.0

    @model_validator(mode="after")
    def _checked(self) -> MaterialConfig:
        if self.name == "pec" and self.thickness_m is not None:
            raise ValueError("a perfect conductor (pec) has no thickness_m: leave it out")
        _ = self.build()
        return self

    def build(self) -> Material:
        """The material; raises RadarError if it is unknown or out of range."""
        from waveformer.simulator.materials import Material

        if self.name == "pec":
            return Material.pec(self.roughness_m)
        matter = permittivity(self.name)
        make = Material.named if isinstance(matter, str) else Material.dielectric
        return make(matter, self.thickness_m, self.roughness_m)  # type: ignore[arg-type]


class SheetConfig(Config):
    """An infinite flat sheet.

    Attributes:
        material: of the table, or a permittivity such as "1.5-0.03j".
        z_m: height of the face towards the radar, where it crosses the z axis.
        thickness_m: of the sheet.
        normal: of the sheet.
        echo: add the sheet's own reflection.
    """

    material: str
    z_m: float
    thickness_m: float
    normal: Vector = (0.0, 0.0, 1.0)
    echo: bool = False

    @model_validator(mode="after")
    def _checked(self) -> SheetConfig:
        _ = self.build()
        return self

    def build(self) -> Sheet:
        """The sheet; raises RadarError if it makes no sense."""
        from waveformer.simulator.occluders import Sheet

        point_m = (0.0, 0.0, self.z_m)
        return Sheet(point_m, self.normal, self.thickness_m, permittivity(self.material), self.echo)


class BoxConfig(Config):
    """A closed box, around the objects or between two corners.

    Attributes:
        material: of the table, or a permittivity such as "1.5-0.03j".
        thickness_m: of the walls.
        margin_m: air between the objects' bounding box and the walls' inner faces.
        min_m, max_m: opposite outer corners, in place of the margin.
    """

    material: str
    thickness_m: float = _BOARD_M
    margin_m: float | None = None
    min_m: Vector | None = None
    max_m: Vector | None = None

    @model_validator(mode="after")
    def _checked(self) -> BoxConfig:
        if (self.min_m is None) != (self.max_m is None):
            raise ValueError("min_m and max_m are the two outer corners of a box: give both, or neither")
        if self.min_m is not None and self.margin_m is not None:
            raise ValueError("margin_m fits a box around the objects, min_m and max_m place it: give one")
        if self.margin_m is not None and not self.margin_m >= 0:
            raise ValueError(f"margin_m must not be negative, got {self.margin_m!r}")
        return self

    def build(self, bounds_m: NDArray[np.float64]) -> Box:
        """The box; raises RadarError if it makes no sense.

        Args:
            bounds_m: lowest and highest corner of the objects, shape (2, 3).
        """
        from waveformer.simulator.occluders import Box

        low, high = self.min_m, self.max_m
        if low is None or high is None:
            air = _MARGIN_M if self.margin_m is None else self.margin_m
            low, high = bounds_m[0] - air - self.thickness_m, bounds_m[1] + air + self.thickness_m
        return Box(low, high, self.thickness_m, permittivity(self.material))


def permittivity(text: str) -> complex | str:
    """The number that a text such as "2.6-0.02j" is, else the text: a name."""
    try:
        return complex(text.replace(" ", ""))
    except ValueError:
        return text


def _plain(text: str) -> Any:
    """Text as the value a TOML file would hold: a boolean, a number, a list of numbers, or the text."""
    if text in ("true", "false"):
        return text == "true"
    try:
        numbers = [float(part) for part in text.split()]
    except ValueError:
        return text
    return numbers[0] if len(numbers) == 1 else tuple(numbers) or text
