"""Parameters of the BSDF plugins `radar_specular` and `radar_sheet`, read and checked in one place.

A Mitsuba scene for rendering and a scene file for the coherent sum go through the same function, so a name or a
value that one refuses the other refuses too. Values stay float64.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.radar import Chirp

SPECULAR, SHEET = "radar_specular", "radar_sheet"

# Narrow enough that a sphere's mean echo keeps pi a^2 to 0.01 dB (it rises by tan^2(width / 2) / 2), wide enough
# that a few hundred pixels across an object of 20 cm find every highlight.
DEFAULT_LOBE_WIDTH_DEG = 5.0
# About a wavelength at 77 GHz.
DEFAULT_CORRELATION_LENGTH_M = 4e-3

_MATTER = ("material", "permittivity", "loss", "thickness")
_RENDER = ("frequency", "lobe_width")
PARAMETERS = {
    SPECULAR: (*_MATTER, "roughness", "correlation_length", *_RENDER),
    SHEET: (*_MATTER, "echo", *_RENDER),
}


@dataclass(frozen=True)
class BsdfParameters:
    """What one of the two plugins was given.

    Attributes:
        plugin: "radar_specular" or "radar_sheet".
        permittivity: "pec", the name of a material (`material` in a scene), or eps' - j eps'' (`permittivity` and
            `loss`).
        thickness_m: of a slab; None for a half space.
        roughness_m: rms height.
        echo: whether a sheet reflects; True for radar_specular.
        frequency_hz: at which a render evaluates it. The coherent sum has a band of its own.
        lobe_width_deg: angle off the mirror direction at which the lobe of a render has fallen to 1/e. A render
            cannot sample a mirror, so the mirror is spread; the power stays. The coherent sum has no lobe: there
            interference makes the specularity.
        correlation_length_m: of the roughness; with the rms height it sets the width of the rough lobe.
    """

    plugin: str
    permittivity: complex | str
    thickness_m: float | None
    roughness_m: float
    echo: bool
    frequency_hz: float
    lobe_width_deg: float
    correlation_length_m: float

    @cached_property
    def material(self) -> Material:
        """What the surface is made of."""
        if self.permittivity == "pec":
            return Material.pec(self.roughness_m)
        if isinstance(self.permittivity, str):
            return Material.named(self.permittivity, self.thickness_m, self.roughness_m)
        return Material.dielectric(self.permittivity, self.thickness_m, self.roughness_m)


def parse_bsdf(plugin: str, values: Mapping[str, Any]) -> BsdfParameters:
    """Check the parameters of a plugin.

    Args:
        plugin: "radar_specular" or "radar_sheet".
        values: name -> value as written in the scene.

    Raises:
        RadarError: an unknown parameter, by name with the known ones, or a value that makes no sense.
    """
    for name in values:
        if name not in PARAMETERS[plugin]:
            raise RadarError(
                f"{plugin} has no parameter {name!r}; known: {', '.join(sorted(PARAMETERS[plugin]))}"
            )
    echo = values.get("echo", plugin == SPECULAR)
    if not isinstance(echo, bool):
        raise RadarError(f"{plugin}: echo must be true or false, got {echo!r}")
    permittivity = _permittivity(plugin, values)
    thickness_m = _number(plugin, values, "thickness", 0.0) if "thickness" in values else None
    if permittivity == "pec" and thickness_m is not None:
        raise RadarError(f"{plugin}: a perfect conductor has no thickness; leave it out")
    if plugin == SHEET and thickness_m is None:
        raise RadarError(f"{plugin} needs thickness, in metres")
    parameters = BsdfParameters(
        plugin,
        permittivity,
        thickness_m,
        _number(plugin, values, "roughness", 0.0),
        echo,
        _number(plugin, values, "frequency", Chirp.from_preset("mito").center_hz, (1e8, 1e12)),
        _number(plugin, values, "lobe_width", DEFAULT_LOBE_WIDTH_DEG, (0.1, 60.0)),
        _number(plugin, values, "correlation_length", DEFAULT_CORRELATION_LENGTH_M, (1e-5, 1.0)),
    )
    _ = parameters.material
    return parameters


def _permittivity(plugin: str, values: Mapping[str, Any]) -> complex | str:
    if ("material" in values) == ("permittivity" in values):
        raise RadarError(f"{plugin} needs either material (a name) or permittivity (a number)")
    if "permittivity" in values:
        real, loss = (_number(plugin, values, name, 0.0) for name in ("permittivity", "loss"))
        return complex(real, -loss)
    if "loss" in values:
        raise RadarError(f"{plugin}: loss belongs to permittivity; a named material has its own")
    name = values["material"]
    if not isinstance(name, str):
        raise RadarError(f"{plugin}: material must be a name, got {type(name).__name__}")
    if name == "pec" and plugin == SHEET:
        raise RadarError(f"{plugin}: a perfect conductor lets nothing through; use {SPECULAR}")
    return name


def _number(
    plugin: str,
    values: Mapping[str, Any],
    name: str,
    default: float,
    limits: tuple[float, float] = (-math.inf, math.inf),
) -> float:
    value = values.get(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        shown = value if isinstance(value, (bool, int, float, str)) else type(value).__name__
        raise RadarError(f"{plugin}: {name} must be a finite number, got {shown!r}")
    if not limits[0] <= value <= limits[1]:
        raise RadarError(f"{plugin}: {name} must lie in {limits[0]:g} .. {limits[1]:g}, got {value!r}")
    return float(value)
