"""Tables on the device: what walls and antennas do over the cosine of an angle or its sine.

They are filled by `reflection`, the one implementation, and looked up many million times.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array4f, Complex2f, Float, UInt32
from waveformer.simulator.device import to_device
from waveformer.simulator.materials import Material
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.reflection import refraction_terms, wall_coefficients
from waveformer.simulator.response_plan import Component
from waveformer.simulator.surroundings import Surroundings

# Entries of an antenna's table over sin(angle): a step of 0.1 degrees at broadside.
GAIN_ENTRIES = 1025
# Entries of a material's table over the cosine: a wall of 10 mm turns by 0.02 rad between two, linear to 4e-5.
_COSINE_ENTRIES = 2049


def look_up(table: Float, cosine: Any, frequency: UInt32) -> Any:
    """Four values at a cosine, linear between the entries of a table."""
    place = cosine * (_COSINE_ENTRIES - 1)
    below = dr.floor(dr.select(place < _COSINE_ENTRIES - 1.001, place, _COSINE_ENTRIES - 1.001))
    row = frequency * _COSINE_ENTRIES + UInt32(below)
    low, high = (dr.gather(Array4f, table, row + step) for step in (0, 1))
    return low + (high - low) * (place - below)


def reflection_table(
    material: Material, frequencies_hz: NDArray[np.float64], change: Component | None = None
) -> Float:
    """Gamma_s and Gamma_p over the cosine, a block of entries a frequency: real and imaginary parts in turn.

    Args:
        material: a dielectric.
        frequencies_hz: shape (M,).
        change: the derivative by this one instead of the values.
    """

    def columns(matter: _Matter) -> tuple[Any, ...]:
        wall = wall_coefficients(
            matter.permittivity, matter.thickness_m, matter.cosine, matter.wavenumber_per_m
        )
        return wall.reflect_s, wall.reflect_p

    return _table(material, frequencies_hz, change, columns)


def transmission_tables(
    wall: Material, frequencies_hz: NDArray[np.float64], change: Component | None = None
) -> tuple[Float, Float]:
    """The same of the transmission, s and p, and of both refraction terms."""

    def plane(matter: _Matter) -> tuple[Any, ...]:
        through = wall_coefficients(
            matter.permittivity, matter.thickness_m, matter.cosine, matter.wavenumber_per_m
        )
        return through.transmit_s, through.transmit_p

    return _table(wall, frequencies_hz, change, plane), _table(
        wall, frequencies_hz, change, lambda matter: refraction_terms(*matter)
    )


class _Matter(NamedTuple):
    """What a block of a table is computed from."""

    permittivity: Any
    thickness_m: Any
    cosine: Any
    wavenumber_per_m: Any


def _table(
    material: Material,
    frequencies_hz: NDArray[np.float64],
    change: Component | None,
    columns: Callable[[_Matter], tuple[Any, ...]],
) -> Float:
    """A block of entries a frequency: complex columns over the cosine, or their derivatives."""
    assert material.permittivity is not None
    cosine = to_device(np.linspace(0.0, 1.0, _COSINE_ENTRIES))
    blocks = []
    for frequency in frequencies_hz:
        value = material.permittivity.at(float(frequency))
        numbers = {
            "real": value.real,
            "imaginary": value.imag,
            "thickness": float(material.thickness_m or 0.0),
        }
        moved = {name: dr.opaque(Float, number) for name, number in numbers.items()}
        if change is not None:
            dr.enable_grad(moved[change])
        matter = _Matter(
            Complex2f(moved["real"], moved["imaginary"]),
            None if material.thickness_m is None else moved["thickness"],
            cosine,
            dr.opaque(Float, 2.0 * np.pi * float(frequency) / SPEED_OF_LIGHT_M_PER_S),
        )
        values = columns(matter)
        if change is not None:
            dr.forward(moved[change])
            values = tuple(dr.grad(value) for value in values)
        blocks.append(_columns(*values))
    return to_device(np.concatenate(blocks))


def _columns(*values: Any) -> NDArray[np.float32]:
    parts = [value.numpy() for value in values]
    return np.stack([part for value in parts for part in (value.real, value.imag)], axis=1)


def gain_tables(surroundings: Surroundings) -> list[Float]:
    """sqrt(G) of both principal planes over the sine of the angle."""
    sine = np.linspace(-1.0, 1.0, GAIN_ENTRIES)
    cosine, nothing = np.sqrt(1.0 - sine**2), np.zeros_like(sine)
    planes = ((sine, nothing, cosine), (nothing, sine, cosine))
    return [to_device(surroundings.antenna.amplitude(np.stack(plane, axis=-1))) for plane in planes]
