"""What `waveformer simulate` can be told, by file and by flag."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from waveformer.cli.matter_config import (
    BoxConfig,
    MaterialConfig,
    SheetConfig,
    Vector,
    from_text,
    with_tuples,
)
from waveformer.config import Config
from waveformer.simulator.antenna import ANTENNA_PRESETS
from waveformer.simulator.front_end import FRONT_END_PRESETS, FrontEnd
from waveformer.simulator.presets import APERTURE_PRESETS, CHIRP_PRESETS, RASTER_PRESETS, lookup_preset

if TYPE_CHECKING:
    from waveformer.simulator.antenna import Antenna
    from waveformer.simulator.radar import Aperture

UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
Unit = Literal["m", "cm", "mm", "in"]

_GRID = ("num_x", "num_y", "spacing_m")
_RASTER = ("row_length_m", "num_rows", "step_m", "row_spacing_m")
# Settings that a scene file replaces, since it says the same of each of its objects.
_OF_MESHES = ("unit", "place_m", "rotate_deg", "fix_winding", "material")


def _preset(kind: str, presets: Mapping[str, dict[str, Any]]) -> BeforeValidator:
    """Let a section be the name of a preset."""

    def convert(value: Any) -> Any:
        return lookup_preset(kind, presets, value) if isinstance(value, str) else with_tuples(value)

    return BeforeValidator(convert)


def _front_end(value: Any) -> Any:
    """Let a front end be the name of a preset, or a section whose values go over a preset."""
    if isinstance(value, str):
        return FrontEnd.from_preset(value)
    if isinstance(value, dict):
        fields = dict(value)
        preset = fields.pop("preset", None)
        base = {} if preset is None else lookup_preset("front end", FRONT_END_PRESETS, preset)
        return FrontEnd.model_validate({**base, **fields})
    return value


class ChirpConfig(Config):
    """The arguments of `Chirp`."""

    start_hz: float
    bandwidth_hz: float
    num_samples: int


class ApertureConfig(Config):
    """The arguments of `Aperture.planar_grid`, or those of `Aperture.raster_rows`."""

    num_x: int | None = None
    num_y: int | None = None
    spacing_m: float | None = None
    row_length_m: float | None = None
    num_rows: int | None = None
    step_m: float | None = None
    row_spacing_m: float | None = None
    center_m: Vector = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _of_one_kind(self) -> ApertureConfig:
        given = {name for name in _GRID + _RASTER if getattr(self, name) is not None}
        if given not in (set(_GRID), set(_RASTER)):
            raise ValueError(
                f"give {', '.join(_GRID)} for a grid, or {', '.join(_RASTER)} for a raster scan; got "
                f"{', '.join(sorted(given)) or 'none'}"
            )
        return self

    def build(self) -> Aperture:
        """The positions of the transmitter."""
        from waveformer.simulator.radar import Aperture

        arguments: dict[str, Any] = self.model_dump(exclude_none=True)
        return (
            Aperture.planar_grid(**arguments) if self.num_x is not None else Aperture.raster_rows(**arguments)
        )


class AntennaConfig(Config):
    """A cosine-power pattern, or an isotropic one where no beam width is given.

    Attributes:
        gain_dbi: power gain at broadside.
        beamwidth_x_deg, beamwidth_y_deg: full half-power widths of the two planes.
    """

    gain_dbi: float = 0.0
    beamwidth_x_deg: float | None = None
    beamwidth_y_deg: float | None = None

    @model_validator(mode="after")
    def _both_widths(self) -> AntennaConfig:
        if (self.beamwidth_x_deg is None) != (self.beamwidth_y_deg is None):
            raise ValueError("beamwidth_x_deg and beamwidth_y_deg belong together: give both, or neither")
        return self

    def build(self) -> Antenna:
        """The pattern."""
        from waveformer.simulator.antenna import Antenna

        if self.beamwidth_x_deg is None or self.beamwidth_y_deg is None:
            return Antenna.isotropic(self.gain_dbi)
        return Antenna.cosine_power(self.gain_dbi, self.beamwidth_x_deg, self.beamwidth_y_deg)


class SimulateConfig(Config):
    """One scan.

    Attributes:
        meshes: mesh files, which keep their places relative to each other, or one Mitsuba scene (.xml).
        unit: length unit of the mesh files.
        place_m: the centre of their common bounding box goes there; None leaves them where they are.
        rotate_deg: turns about the fixed x, then y, then z axis through that centre, before placing.
        fix_winding: flip closed bodies that are turned inside out.
        material: of all meshes.
        sheets: infinite sheets in the way.
        box: a closed box around the objects.
        radar: name of a preset, or start_hz, bandwidth_hz and num_samples.
        aperture: name of a preset, or a grid, or a raster scan.
        receivers: name of a preset, or receiver minus transmitter for each of them; None puts the one receiver at
            the transmitter.
        antenna: name of a preset, or gain and widths; None means isotropic with 0 dBi.
        polarization: direction of E at both antennas.
        front_end: name of a preset, or fields of `FrontEnd`, over those of `preset` if given; None means ideal.
        mode: "fast", or "exact" (slow reference).
        tile_positions: most antenna positions in flight at once; bounds memory.
        threads: of the ray tracer; None = all cores.
        workers: processes of a streamed scan, each with one thread; None = as many as threads.
        seed: of all that the front end draws at random, and recorded in the scan.
    """

    meshes: Annotated[tuple[str, ...], Field(min_length=1)]
    unit: Unit = "m"
    place_m: Vector | None = None
    rotate_deg: Vector = (0.0, 0.0, 0.0)
    fix_winding: bool = False
    material: Annotated[MaterialConfig, BeforeValidator(from_text("name"))] = MaterialConfig()
    sheets: tuple[Annotated[SheetConfig, BeforeValidator(from_text("material"))], ...] = ()
    box: Annotated[BoxConfig, BeforeValidator(from_text("material"))] | None = None
    radar: Annotated[ChirpConfig, _preset("radar", CHIRP_PRESETS)] = ChirpConfig(**CHIRP_PRESETS["mito"])
    aperture: Annotated[ApertureConfig, _preset("aperture", APERTURE_PRESETS | RASTER_PRESETS)] = (
        ApertureConfig(**APERTURE_PRESETS["small"])
    )
    receivers: str | tuple[Vector, ...] | None = None
    antenna: Annotated[AntennaConfig, _preset("antenna", ANTENNA_PRESETS)] | None = None
    polarization: Vector = (0.0, 1.0, 0.0)
    front_end: Annotated[FrontEnd, BeforeValidator(_front_end)] | None = None
    mode: Literal["draft", "fast", "exact"] = "fast"
    tile_positions: Annotated[int, Field(ge=1)] | None = None
    threads: Annotated[int, Field(ge=1)] | None = None
    workers: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0)] = 0

    @property
    def is_scene(self) -> bool:
        """True if a Mitsuba scene file brings the objects."""
        return any(_is_scene(mesh) for mesh in self.meshes)

    @model_validator(mode="after")
    def _scene_alone(self) -> SimulateConfig:
        if not self.is_scene:
            return self
        if len(self.meshes) > 1:
            raise ValueError(
                f"a scene file comes alone, got {', '.join(self.meshes)}: name the meshes in the scene"
            )
        fields = type(self).model_fields
        extra = [name for name in _OF_MESHES if getattr(self, name) != fields[name].default]
        if extra:
            raise ValueError(
                f"{', '.join(extra)}: a scene file says this of each of its objects itself; leave it out"
            )
        return self


def _is_scene(path: str) -> bool:
    return path.lower().endswith(".xml")
