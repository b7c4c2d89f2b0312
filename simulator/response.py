"""What a pair of ways does to an echo besides spreading and delay, in Dr.Jit: matter, sheets, walls, antennas.

The complex factor W of one pair of sample and antenna,

    h = (j / 4 pi) sum W V (cos_i + cos_r) / 2 dA / (R_tx R_rx) exp(-j k (R_tx + R_rx)),

with W = Gamma of the surface (times the form factor of a flat rectangular sample), times the transmission of
every sheet and wall that the two ways cross, times the amplitude gains of both antennas. Its NumPy float64 twin is `reference_response`.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from waveformer.simulator.backend import Array3f, Complex2f, Float, UInt32
from waveformer.simulator.device import to_device
from waveformer.simulator.echo_terms import Leg, straight_leg
from waveformer.simulator.form_factor import rectangle_form_factor
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.reflection import coherent_loss
from waveformer.simulator.response_plan import ResponsePlan, WallChange
from waveformer.simulator.response_tables import (
    GAIN_ENTRIES,
    gain_tables,
    look_up,
    reflection_table,
    transmission_tables,
)

# Differences of the path factor: the centre and a step either way along each axis.
_STENCIL, _STEP_M = 7, 5e-4


class _Field(NamedTuple):
    """A complex vector: the field that one way carries."""

    real: Any
    imaginary: Any

    def through(self, direction: Any, normal: Any, transmit_s: Any, transmit_p: Any) -> _Field:
        """Behind a wall: what lies across the plane of incidence changes by s, the rest by p."""
        across = _unit_or_zero(dr.cross(direction, normal))
        share = Complex2f(dr.dot(self.real, across), dr.dot(self.imaginary, across))
        extra = (transmit_s - transmit_p) * share
        return _Field(
            transmit_p.real * self.real - transmit_p.imag * self.imaginary + extra.real * across,
            transmit_p.real * self.imaginary + transmit_p.imag * self.real + extra.imag * across,
        )


class Path(NamedTuple):
    """What all samples of a cell share on their ways, T(x) = value exp(gradient (x - centre)).

    Attributes:
        value: complex factor at the centre.
        gradient_real, gradient_imaginary: of its logarithm, per metre.
    """

    value: Any
    gradient_real: Any
    gradient_imaginary: Any


class Response:
    """W of one target, on the device: a factor of the surface times a factor of the ways.

    Args:
        plan: what it consists of and where it is evaluated.
    """

    def __init__(self, plan: ResponsePlan) -> None:
        self._plan = plan
        material, surroundings = plan.material, plan.surroundings
        self._material, self._surroundings, self._crossings = material, surroundings, plan.crossings
        self._facet = None if plan.facet_m is None else _constant(plan.facet_m)
        self._walls = [sheet.material for sheet in surroundings.sheets]
        if surroundings.box is not None:
            self._walls.append(surroundings.box.material)
        self._reflection_changes: dict[WallChange, Float] = {}
        self._transmission_changes: dict[WallChange, tuple[Float, Float]] = {}
        self._roughness = dr.opaque(Float, material.roughness_m)
        self._wavenumbers = to_device(2.0 * np.pi * plan.frequencies_hz / SPEED_OF_LIGHT_M_PER_S)
        self._reflections = None if material.is_conductor else reflection_table(material, plan.frequencies_hz)
        self._transmissions = [transmission_tables(wall, plan.frequencies_hz) for wall in self._walls]
        self._polarization = _constant(surroundings.polarization)
        self._gain = None if surroundings.antenna.is_isotropic else gain_tables(surroundings)
        broadside = float(surroundings.antenna.amplitude(np.array([0.0, 0.0, 1.0])))
        self._broadside = dr.opaque(Float, broadside)
        self._common_gain = dr.opaque(Float, broadside**2)

    def along(self, seed: Float, changes: Sequence[tuple[WallChange, float]]) -> Response:
        """The same factor with numbers of its matter moving with the seed, each at its rate."""
        moving = copy(self)
        moving._transmissions = list(self._transmissions)
        for change, rate in changes:
            moving._move(seed * rate, change)
        return moving

    def _move(self, seed: Any, change: WallChange) -> None:
        if change.wall == self._plan.surface_wall and change.component == "roughness":
            self._roughness = self._roughness + seed
        elif change.wall == self._plan.surface_wall and self._reflections is not None:
            self._reflections = self._reflections + seed * self._reflection_change(change)
        if change == WallChange(self._plan.surface_wall, "thickness") and self._plan.facet_growth is not None:
            self._facet = self._facet + seed * _constant(self._plan.facet_growth)
        if change.wall is not None:
            self._transmissions[change.wall] = tuple(
                table + seed * moved
                for table, moved in zip(
                    self._transmissions[change.wall], self._transmission_change(change), strict=True
                )
            )

    # Derivatives of tables are kept: many launches share them.
    def _reflection_change(self, change: WallChange) -> Float:
        assert change.component != "roughness"
        if change not in self._reflection_changes:
            table = reflection_table(self._material, self._plan.frequencies_hz, change.component)
            self._reflection_changes[change] = table
        return self._reflection_changes[change]

    def _transmission_change(self, change: WallChange) -> tuple[Float, Float]:
        assert change.wall is not None and change.component != "roughness"
        if change not in self._transmission_changes:
            wall = self._walls[change.wall]
            tables = transmission_tables(wall, self._plan.frequencies_hz, change.component)
            self._transmission_changes[change] = tables
        return self._transmission_changes[change]

    def surface(self, legs: list[Leg], cosine: Any, normal: Any, frequency: UInt32) -> Any:
        """Gamma at the local angle, with the form factor of flat rectangular samples and the gain of isotropic antennas.

        That gain belongs here since cells skip the path factor where it is 1.

        Args:
            legs: the way of the transmitter, and of the receiver unless monostatic.
            cosine: of the local angle of incidence.
            normal: of the sample (Array3f).
            frequency: entry of the plan's frequencies.

        Returns:
            Complex2f.
        """
        wavenumber = dr.gather(Float, self._wavenumbers, frequency)
        weight = self._reflection(legs, cosine, normal, wavenumber, frequency)
        if self._facet is not None:
            weight = weight * rectangle_form_factor(legs, normal, self._facet, wavenumber)
        return weight * self._common_gain if self._gain is None else weight

    def path(self, point: Any, legs: list[Leg], frequency: UInt32) -> Any:
        """Transmission of all that both ways cross, and the gains of antennas with a pattern.

        Args:
            point: sample in the radar frame (Array3f).
            legs, frequency: as in `surface`.

        Returns:
            Complex2f.
        """
        gain = self._amplitude_gain(legs[0])
        weight = Complex2f(gain * (gain if len(legs) == 1 else self._amplitude_gain(legs[1])), 0.0)
        if self._surroundings.occludes:
            fields = [_transverse(self._polarization, leg.direction) for leg in legs]
            weight = weight * self._transmission(point, legs, fields, frequency)
        return weight

    def path_of_cells(self, center: Any, antennas: list[Any], frequency: UInt32) -> Path | None:
        """The path factor around the centres of cells, by differences, one cell a lane.

        Over a cell it is linear in the logarithm to 1e-3 and better, and a cell whose samples differ in the walls
        they cross is not summed as one.

        Args:
            center: of the cell (Array3f).
            antennas: transmitter, and receiver unless monostatic (Array3f).
            frequency: entry of the plan's frequencies.

        Returns:
            None if the factor is 1 everywhere.
        """
        if self._gain is None and not self._surroundings.occludes:
            return None
        lanes = dr.width(center)
        lane = dr.arange(UInt32, _STENCIL * lanes)
        cell = lane // _STENCIL
        probe = lane - cell * _STENCIL
        offsets = to_device(_STEP_M * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]).ravel())
        point = dr.gather(Array3f, center, cell) + dr.gather(Array3f, offsets, probe)
        legs = [straight_leg(dr.gather(Array3f, antenna, cell), point) for antenna in antennas]
        factor = self.path(point, legs, dr.gather(UInt32, frequency, cell))
        real, imaginary = factor.real, factor.imag
        dr.eval(real, imaginary)
        own = dr.arange(UInt32, lanes) * _STENCIL
        value, *around = (
            Complex2f(dr.gather(Float, real, own + i), dr.gather(Float, imaginary, own + i))
            for i in range(_STENCIL)
        )
        exists = dr.squared_norm(value) > 0
        inverse = dr.select(
            exists, dr.rcp(dr.select(exists, value, Complex2f(1.0, 0.0))), Complex2f(0.0, 0.0)
        )
        slopes = [
            (ahead - behind) * inverse * (0.5 / _STEP_M)
            for ahead, behind in zip(around[:3], around[3:], strict=True)
        ]
        path = Path(
            value, Array3f(*(slope.real for slope in slopes)), Array3f(*(slope.imag for slope in slopes))
        )
        dr.eval(path.value, path.gradient_real, path.gradient_imaginary)
        return path

    def _reflection(
        self, legs: list[Leg], cosine: Any, normal: Any, wavenumber: Any, frequency: UInt32
    ) -> Any:
        """Gamma: s and p by how the fields lie, with the coherent loss of a rough surface."""
        material = self._material
        loss: Any = -1.0 if material.is_conductor else 1.0
        if material.roughness_m > 0:
            loss = loss * coherent_loss(self._roughness, cosine, wavenumber)
        if self._reflections is None:
            return Complex2f(loss, 0.0)
        shares = []
        for way in legs:
            field = _transverse(self._polarization, way.direction)
            part = dr.dot(field, _unit_or_zero(dr.cross(way.direction, normal)))
            shares.append(part * part)
        share_s = shares[0] if len(shares) == 1 else 0.5 * (shares[0] + shares[1])
        both = look_up(self._reflections, cosine, frequency)
        real, imaginary = both.z + (both.x - both.z) * share_s, both.w + (both.y - both.w) * share_s
        return Complex2f(real * loss, imaginary * loss)

    def _transmission(self, point: Any, legs: list[Leg], fields: list[Any], frequency: UInt32) -> Any:
        """Product of the fields behind all that the two ways cross, over that in free space."""
        carried = [
            self._behind_all(point, leg, field, frequency) for leg, field in zip(legs, fields, strict=True)
        ]
        one, other = carried[0], carried[-1]
        product = Complex2f(
            dr.dot(one.real, other.real) - dr.dot(one.imaginary, other.imaginary),
            dr.dot(one.real, other.imaginary) + dr.dot(one.imaginary, other.real),
        )
        return product if len(legs) == 1 else product / dr.dot(fields[0], fields[1])

    def _behind_all(self, point: Any, leg: Leg, field: Any, frequency: UInt32) -> _Field:
        carried = _Field(field, Array3f(0.0))
        for index, sheet in enumerate(self._surroundings.sheets):
            normal = _constant(sheet.normal)
            height = dr.dot(point - _constant(sheet.point_m), normal)
            crosses = height * (height + dr.dot(leg.direction, normal) / leg.inverse_m) < 0
            behind = _behind(carried, leg, normal, self._transmissions[index], frequency)
            carried = _where(crosses, behind, carried)
        box = self._surroundings.box
        if box is None or self._crossings == "none":
            return carried
        entry, leave = _box_crossings(point, leg, _constant(box.middle_min_m), _constant(box.middle_max_m))
        for crosses, normal in (leave,) if self._crossings == "leaving" else (entry, leave):
            behind = _behind(carried, leg, normal, self._transmissions[-1], frequency)
            carried = _where(crosses, behind, carried)
        return carried

    def _amplitude_gain(self, leg: Leg) -> Any:
        """sqrt(G) towards the sample: the cuts through both principal planes, over broadside."""
        if self._gain is None:
            return 1.0
        towards = leg.direction
        amplitude = dr.rcp(self._broadside)
        for table, component in zip(self._gain, (towards.x, towards.y), strict=True):
            sine = component * dr.rsqrt(component * component + towards.z * towards.z)
            place = (sine + 1.0) * (0.5 * (GAIN_ENTRIES - 1))
            below = dr.floor(dr.select(place < GAIN_ENTRIES - 1.001, place, GAIN_ENTRIES - 1.001))
            part = place - below
            low, high = (dr.gather(Float, table, UInt32(below) + step) for step in (0, 1))
            amplitude = amplitude * (low + part * (high - low))
        return dr.select(towards.z > 0, amplitude, 0.0)


def _behind(carried: _Field, leg: Leg, normal: Any, tables: tuple[Float, Float], frequency: UInt32) -> _Field:
    """The field behind one wall."""
    cosine = dr.abs(dr.dot(leg.direction, normal))
    through, bent = (look_up(table, cosine, frequency) for table in tables)
    turn = Complex2f(bent.w, -bent.z) * leg.inverse_m  # exp of a small number: 0.3 at most
    factor = (1.0 - Complex2f(bent.x, bent.y) * leg.inverse_m) * (
        1.0 + turn * (1.0 + turn * (0.5 + turn * (1.0 / 6.0)))
    )
    transmit_s, transmit_p = Complex2f(through.x, through.y), Complex2f(through.z, through.w)
    return carried.through(leg.direction, normal, transmit_s * factor, transmit_p * factor)


def _box_crossings(point: Any, leg: Leg, low: Any, high: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """(whether, normal of the wall) where a way enters and where it leaves a box."""
    length = dr.rcp(leg.inverse_m)
    nearest = farthest = None
    for axis in range(3):
        rate = leg.direction[axis]
        # a way along a wall never reaches it
        rate = dr.select(dr.abs(rate) > 1e-9, rate, 1e-9)
        first, second = (low[axis] - point[axis]) / rate, (high[axis] - point[axis]) / rate
        swap = first > second
        early, late = dr.select(swap, second, first), dr.select(swap, first, second)
        unit = Array3f(*(float(axis == other) for other in range(3)))
        if nearest is None or farthest is None:
            nearest, farthest = (early, unit), (late, unit)
        else:
            nearest = _choose(early > nearest[0], (early, unit), nearest)
            farthest = _choose(late < farthest[0], (late, unit), farthest)
    assert nearest is not None and farthest is not None
    meets = nearest[0] < farthest[0]
    return tuple((meets & (at > 0) & (at < length), normal) for at, normal in (nearest, farthest))  # type: ignore[return-value]


def _choose(condition: Any, one: tuple[Any, Any], other: tuple[Any, Any]) -> tuple[Any, Any]:
    return dr.select(condition, one[0], other[0]), dr.select(condition, one[1], other[1])


def _where(condition: Any, one: _Field, other: _Field) -> _Field:
    return _Field(
        dr.select(condition, one.real, other.real), dr.select(condition, one.imaginary, other.imaginary)
    )


def _transverse(polarization: Any, direction: Any) -> Any:
    """Unit vector of E across the way: the antenna's polarisation less its part along it."""
    return _unit_or_zero(polarization - dr.dot(polarization, direction) * direction)


def _unit_or_zero(vector: Any) -> Any:
    square = dr.squared_norm(vector)
    return vector * dr.select(square > 1e-12, dr.rsqrt(square), 0.0)


def _constant(vector: Any) -> Any:
    return Array3f(*(dr.opaque(Float, float(value)) for value in vector))
