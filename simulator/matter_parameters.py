"""Matter whose numbers may be tensors: surfaces, sheets and boxes of the differentiable model.

A number that requires a gradient is known by its `WallChange`; the forward model itself sees plain floats.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch

from waveformer.simulator import occluders
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.arguments import complex_number, follows, real_number, shown
from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material
from waveformer.simulator.permittivity import Permittivity, lookup_permittivity
from waveformer.simulator.response_plan import WallChange
from waveformer.simulator.surroundings import Surroundings

# Steps that tell neighbours apart well above rounding: relative, and for a roughness of zero in metres.
_RELATIVE_STEP, _ROUGHNESS_STEP_M = 1e-3, 1e-6


@dataclass(frozen=True, eq=False)
class Sheet:
    """An infinite flat sheet as `waveformer.simulator.Sheet`, whose matter may be tensors.

    Attributes:
        point_m, normal: as there, constants.
        thickness_m: number or real scalar tensor.
        permittivity: complex number eps' - j eps'', name, or complex scalar tensor.
        echo: whether the sheet's own reflection is added.
    """

    point_m: Any
    normal: Any
    thickness_m: float | torch.Tensor
    permittivity: complex | str | torch.Tensor
    echo: bool = False


@dataclass(frozen=True, eq=False)
class Box:
    """A closed box as `waveformer.simulator.Box`, whose matter may be tensors.

    Attributes:
        min_m, max_m: as there, constants.
        thickness_m, permittivity: as of a `Sheet`.
    """

    min_m: Any
    max_m: Any
    thickness_m: float | torch.Tensor
    permittivity: complex | str | torch.Tensor


@dataclass(frozen=True, eq=False)
class Matter:
    """All matter of a scene.

    Attributes:
        permittivity: of the target; None for a perfect conductor.
        thickness_m: of the target's walls; None for a half space.
        roughness_m: of the target.
        sheets, box: occluders, of this module or of `waveformer.simulator`.
    """

    permittivity: complex | str | Permittivity | torch.Tensor | None
    thickness_m: float | torch.Tensor | None
    roughness_m: float | torch.Tensor
    sheets: Sequence[Sheet | occluders.Sheet]
    box: Box | occluders.Box | None

    def __post_init__(self) -> None:
        for sheet in self.sheets:
            if not isinstance(sheet, Sheet | occluders.Sheet):
                raise RadarError(f"sheets must be Sheet objects, got {shown(sheet)}")
        if not isinstance(self.box, Box | occluders.Box | None):
            raise RadarError(f"box must be a Box or None, got {shown(self.box)}")

    def variables(self) -> Iterator[tuple[WallChange, torch.Tensor]]:
        """Every number that requires a gradient, as a real scalar tensor."""
        yield from _variables(None, self.permittivity, self.thickness_m)
        if isinstance(self.roughness_m, torch.Tensor) and follows(self.roughness_m):
            yield WallChange(None, "roughness"), self.roughness_m.reshape(())
        walls = [*self.sheets, *([] if self.box is None else [self.box])]
        for index, wall in enumerate(walls):
            yield from _variables(index, wall.permittivity, wall.thickness_m)

    def material(self) -> Material:
        """The target's material at the present values."""
        thickness_m = None if self.thickness_m is None else real_number("thickness_m", self.thickness_m)
        roughness_m = real_number("roughness_m", self.roughness_m)
        if self.permittivity is None:
            if thickness_m is not None:
                raise RadarError("thickness_m needs a permittivity: a perfect conductor has no thickness")
            return Material.pec(roughness_m)
        name, permittivity = _permittivity(self.permittivity)
        return Material(name, permittivity, thickness_m, roughness_m)

    def surroundings(self, antenna: Antenna | None, polarization: Any) -> Surroundings:
        """Antennas and occluders at the present values; no antenna means isotropic with 0 dBi."""
        sheets = [
            sheet
            if isinstance(sheet, occluders.Sheet)
            else occluders.Sheet(
                sheet.point_m,
                sheet.normal,
                real_number("sheet thickness_m", sheet.thickness_m),
                _plain(sheet.permittivity),
                sheet.echo,
            )
            for sheet in self.sheets
        ]
        box = self.box
        if isinstance(box, Box):
            thickness_m = real_number("box thickness_m", box.thickness_m)
            box = occluders.Box(box.min_m, box.max_m, thickness_m, _plain(box.permittivity))
        return Surroundings(Antenna.isotropic() if antenna is None else antenna, sheets, box, polarization)


def as_sheets(sheets: Any) -> tuple[Any, ...]:
    """One sheet or a sequence of them as a tuple."""
    return tuple(sheets) if isinstance(sheets, Sequence) and not isinstance(sheets, str) else (sheets,)


def changed(
    material: Material, surroundings: Surroundings, change: WallChange, steps: float = 1.0
) -> tuple[Material, Surroundings, float]:
    """The scene with one of its numbers moved a little, and by how much: the imaginary part to more loss.

    Args:
        material, surroundings: the scene.
        change: the number.
        steps: of the usual size, which is a thousandth.
    """
    if change.wall is None:
        moved, step = _moved(material, change, steps)
        return moved, surroundings, step
    sheets, box = list(surroundings.sheets), surroundings.box
    if change.wall < len(sheets):
        old = sheets[change.wall]
        moved, step = _moved(old.material, change, steps)
        assert moved.permittivity is not None and moved.thickness_m is not None
        sheets[change.wall] = occluders.Sheet(
            old.point_m, old.normal, moved.thickness_m, _constant(moved, change), old.echo
        )
    else:
        assert box is not None
        moved, step = _moved(box.material, change, steps)
        assert moved.thickness_m is not None
        box = occluders.Box(box.min_m, box.max_m, moved.thickness_m, _constant(moved, change))
    return material, Surroundings(surroundings.antenna, sheets, box, surroundings.polarization), step


def _constant(wall: Material, change: WallChange) -> complex | str:
    """Permittivity of a wall as its class takes it: a named one stays named while its thickness moves."""
    assert wall.permittivity is not None
    if change.component == "thickness" and wall.name != "dielectric":
        return wall.name
    return complex(wall.permittivity.real, -wall.permittivity.loss)


def _moved(material: Material, change: WallChange, steps: float) -> tuple[Material, float]:
    """A material with one number moved, and by how much."""
    permittivity, thickness_m, roughness_m = material.permittivity, material.thickness_m, material.roughness_m
    if change.component == "roughness":
        step = steps * max(_RELATIVE_STEP * roughness_m, _ROUGHNESS_STEP_M)
        return Material(material.name, permittivity, thickness_m, roughness_m + step), step
    if change.component == "thickness":
        assert thickness_m is not None
        step = steps * _RELATIVE_STEP * thickness_m
        return Material(material.name, permittivity, thickness_m + step, roughness_m), step
    assert permittivity is not None
    step = steps * _RELATIVE_STEP * permittivity.real
    real, loss = permittivity.real, permittivity.loss
    if change.component == "real":
        real += step
    else:
        loss, step = loss + step, -step  # the imaginary part is -eps''
    return Material(material.name, Permittivity(real, loss=loss), thickness_m, roughness_m), step


def _variables(
    wall: int | None, permittivity: Any, thickness_m: Any
) -> Iterator[tuple[WallChange, torch.Tensor]]:
    if _is_variable(permittivity):
        if not permittivity.is_complex():
            yield WallChange(wall, "real"), permittivity.reshape(())
        else:
            parts = torch.view_as_real(permittivity.resolve_conj()).reshape(2)
            yield WallChange(wall, "real"), parts[0]
            yield WallChange(wall, "imaginary"), parts[1]
    if _is_variable(thickness_m):
        yield WallChange(wall, "thickness"), thickness_m.reshape(())


def _is_variable(value: Any) -> bool:
    return isinstance(value, torch.Tensor) and follows(value)


def _plain(value: Any) -> complex | str:
    """A permittivity as `waveformer.simulator` takes it."""
    return value if isinstance(value, str) else complex_number("permittivity", value)


def _permittivity(value: Any) -> tuple[str, Permittivity]:
    if isinstance(value, Permittivity):
        return "dielectric", value
    plain = _plain(value)
    if isinstance(plain, str):
        return plain, lookup_permittivity(plain)
    return "dielectric", Permittivity.constant(plain)
