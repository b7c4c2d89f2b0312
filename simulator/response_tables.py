"""Tables on the device: what walls and antennas do over the cosine of an angle or its sine.

They are filled by `reflection`, the one implementation, and looked up many million times.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array4f, Complex2f, Float, UInt32
from waveformer.simulator.device import to_device
from waveformer.simulator.materials import Material
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.reflection import refraction_terms, wall_coefficients
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


def reflection_table(material: Material, frequencies_hz: NDArray[np.float64]) -> Float:
    """Gamma_s and Gamma_p over the cosine, a block of entries a frequency: real and imaginary parts in turn."""
    thickness = None if material.thickness_m is None else dr.opaque(Float, material.thickness_m)
    blocks = []
    for cosine, permittivity, wavenumber in _table_axes(material, frequencies_hz):
        wall = wall_coefficients(permittivity, thickness, cosine, wavenumber)
        blocks.append(_columns(wall.reflect_s, wall.reflect_p))
    return to_device(np.concatenate(blocks))


def transmission_tables(wall: Material, frequencies_hz: NDArray[np.float64]) -> tuple[Float, Float]:
    """The same of the transmission, s and p, and of both refraction terms."""
    plane, bent = [], []
    thickness = dr.opaque(Float, float(wall.thickness_m or 0.0))
    for cosine, permittivity, wavenumber in _table_axes(wall, frequencies_hz):
        through = wall_coefficients(permittivity, thickness, cosine, wavenumber)
        plane.append(_columns(through.transmit_s, through.transmit_p))
        bent.append(_columns(*refraction_terms(permittivity, thickness, cosine, wavenumber)))
    return to_device(np.concatenate(plane)), to_device(np.concatenate(bent))


def _table_axes(material: Material, frequencies_hz: NDArray[np.float64]) -> Iterator[tuple[Any, Any, Any]]:
    """Cosines, permittivity and wave number of every block of a table."""
    assert material.permittivity is not None
    cosine = to_device(np.linspace(0.0, 1.0, _COSINE_ENTRIES))
    for frequency in frequencies_hz:
        value = material.permittivity.at(float(frequency))
        permittivity = Complex2f(dr.opaque(Float, value.real), dr.opaque(Float, value.imag))
        yield cosine, permittivity, dr.opaque(Float, 2.0 * np.pi * float(frequency) / SPEED_OF_LIGHT_M_PER_S)


def _columns(*values: Any) -> NDArray[np.float32]:
    parts = [value.numpy() for value in values]
    return np.stack([part for value in parts for part in (value.real, value.imag)], axis=1)


def gain_tables(surroundings: Surroundings) -> list[Float]:
    """sqrt(G) of both principal planes over the sine of the angle."""
    sine = np.linspace(-1.0, 1.0, GAIN_ENTRIES)
    cosine, nothing = np.sqrt(1.0 - sine**2), np.zeros_like(sine)
    planes = ((sine, nothing, cosine), (nothing, sine, cosine))
    return [to_device(surroundings.antenna.amplitude(np.stack(plane, axis=-1))) for plane in planes]
