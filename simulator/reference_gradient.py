"""Gradients of the differentiable model beside central differences of its float64 twin.

A `GradientCase` is a scene and a loss: the squared distance of its signal from that of the same surface elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from waveformer.simulator import occluders
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.differentiable import Box, FrozenScene, Sheet, freeze, simulate
from waveformer.simulator.materials import Material
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference_frozen import FrozenTwin
from waveformer.simulator.surroundings import Surroundings

# The loss compares with the signal of the same surface turned and moved this far, well within a lambda / 8, and
# weaker: with a difference in phase alone the gradients by amplitudes would be small leftovers.
AIM_SIZE, TURN_RAD, SHIFT_M = 0.8, np.array([0.003, 0.002, -0.004]), np.array([1e-4, -2e-4, 2e-4])
# Steps of the central differences: phases turn by 3e-4 rad at most, so they err by 1e-7 and round off by less.
STEP_M, STEP = 1e-7, 1e-4
# Largest relative errors, so that gradients serve a descent: of a rigid motion all samples add up, so that float32 and
# the interpolations average out; single positions do not have that, and tables of matter are linear between entries.
ASKED = {"translation": 2e-4, "rotation": 2e-4, "tx_m": 1e-3, "rx_m": 1e-3}
ASKED |= {kind: 1e-3 for kind in ("random motion", "smooth motion", "single vertices")}
ASKED |= {name: 5e-3 for name in ("reflectivity", "permittivity", "thickness_m", "roughness_m")}
ASKED |= {f"{wall} {number}": 1e-3 for wall in ("sheet", "box") for number in ("permittivity", "thickness_m")}
ASKED |= {"antenna_gain_db": 1e-3, "range_bias_m": 1e-3}
Spectrum = NDArray[np.complex128]
# What the signal is multiplied with at the end.
LINEAR = {"reflectivity", "antenna_gain_db", "range_bias_m"}


@dataclass(frozen=True, eq=False)
class GradientCase:
    """A scene whose numbers may all be differentiated.

    Attributes:
        vertices, faces, chirp, tx_m, rx_m: see `differentiable.simulate`.
        permittivity, thickness_m, roughness_m: of the target.
        sheet: (permittivity, thickness_m) of a slanted sheet half way to the target; None for none.
        sheet_echo: whether it sends back an echo.
        box: (permittivity, thickness_m) of a box around the target.
        box_echo: whether it sends back an echo, which takes the twin long.
        antenna: of both antennas.
        mode: "fast", or a Numerics.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.float64]
    chirp: Chirp
    tx_m: NDArray[np.float64]
    rx_m: NDArray[np.float64] | None = None
    permittivity: complex | None = None
    thickness_m: float | None = None
    roughness_m: float = 0.0
    sheet: tuple[complex, float] | None = None
    sheet_echo: bool = False
    box: tuple[complex, float] | None = None
    box_echo: bool = False
    antenna: Antenna = field(default_factory=Antenna.isotropic)
    mode: str | Numerics = "fast"

    @property
    def numbers(self) -> dict[str, Any]:
        """Everything that a gradient is asked for, by name."""
        numbers: dict[str, Any] = {"vertices": self.vertices, "tx_m": self.tx_m}
        numbers |= {"reflectivity": 1.0 + 0j, "antenna_gain_db": 0.0, "range_bias_m": 0.0}
        for name in ("rx_m", "permittivity", "thickness_m", "roughness_m"):
            if getattr(self, name) is not None:
                numbers[name] = getattr(self, name)
        for name, wall in (("sheet", self.sheet), ("box", self.box)):
            if wall is not None:
                numbers |= {f"{name} permittivity": wall[0], f"{name} thickness_m": wall[1]}
        return numbers

    @cached_property
    def _places(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Point of the sheet, corners of the box."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        return np.array([0.0, 0.0, high[2] / 2]), low - [0.02, 0.03, 0.01], high + [0.03, 0.02, 0.025]

    def _walls(self, numbers: dict[str, Any], sheet: Any, box: Any) -> dict[str, Any]:
        """The occluders, of the classes given."""
        point, low, high = self._places
        walls: dict[str, Any] = {"sheets": (), "box": None}
        if self.sheet is not None:
            matter = numbers["sheet thickness_m"], numbers["sheet permittivity"]
            walls["sheets"] = (sheet(point, np.array([0.1, 0.05, 1.0]), *matter, self.sheet_echo),)
        if self.box is not None:
            walls["box"] = box(low, high, numbers["box thickness_m"], numbers["box permittivity"])
        return walls

    @cached_property
    def frozen(self) -> FrozenScene:
        """The discrete part."""
        walls = self._walls(self.numbers, occluders.Sheet, occluders.Box)
        frozen = freeze(self.vertices, self.faces, self.chirp, self.tx_m, self.rx_m, mode=self.mode, **walls)
        return frozen if self.box_echo else replace(frozen, walls=[])

    @cached_property
    def twin(self) -> FrozenTwin:
        """The float64 twin of the discrete part."""
        return FrozenTwin.at(self.frozen, self.vertices, Aperture(self.tx_m, self.rx_m))

    def exact(self, **moved: Any) -> Spectrum:
        """The twin's signal, some numbers at other values."""
        numbers = self.numbers | moved
        surface, surroundings = self._echoes if set(moved) <= LINEAR else self._echoes_at(numbers)
        h = surface * numbers["reflectivity"] + surroundings
        turn = self.chirp.frequencies_hz * numbers["range_bias_m"] / SPEED_OF_LIGHT_M_PER_S
        return np.asarray(h * 10 ** (numbers["antenna_gain_db"] / 10) * np.exp(-2j * np.pi * turn))

    @cached_property
    def _echoes(self) -> tuple[Spectrum, Spectrum]:
        return self._echoes_at(self.numbers)

    def _echoes_at(self, numbers: dict[str, Any]) -> tuple[Spectrum, Spectrum]:
        """Of the target, and of what surrounds it."""
        walls = self._walls(numbers, occluders.Sheet, occluders.Box)
        permittivity, roughness_m = numbers.get("permittivity"), numbers["roughness_m"]
        material = Material.pec(roughness_m)
        if permittivity is not None:
            material = Material.dielectric(permittivity, numbers.get("thickness_m"), roughness_m)
        place = numbers["vertices"], Aperture(numbers["tx_m"], numbers.get("rx_m")), material
        alone = replace(self.twin, scene=replace(self.frozen, walls=[]))
        others = replace(self.twin, scene=replace(self.frozen, targets=[]), shares=[])
        around = Surroundings(self.antenna, **walls)
        return alone.echo(*place, Surroundings(self.antenna, **_silent(walls))), others.echo(*place, around)

    def fast(self, **tensors: torch.Tensor) -> torch.Tensor:
        """The differentiable model's signal, some numbers as tensors."""
        numbers = self.numbers | tensors
        direct = {name: value for name, value in numbers.items() if " " not in name}
        walls = self._walls(numbers, Sheet, Box)
        return simulate(
            faces=self.faces, chirp=self.chirp, antenna=self.antenna, frozen=self.frozen, **walls, **direct
        )

    @cached_property
    def aim(self) -> Spectrum:
        """The signal that the loss compares with."""
        return AIM_SIZE * self.exact(vertices=turned(self.vertices, TURN_RAD) + SHIFT_M)

    def loss(self, h: Any) -> Any:
        """Squared distance from the aim, over that of zero."""
        aim = torch.from_numpy(self.aim) if isinstance(h, torch.Tensor) else self.aim
        return (abs(h - aim) ** 2).sum() / (abs(self.aim) ** 2).sum()

    def gradients(self, *names: str) -> dict[str, NDArray[Any]]:
        """Of the loss, by the differentiable model."""
        tensors = {name: torch.tensor(self.numbers[name], requires_grad=True) for name in names}
        for name in set(names) - {"reflectivity", "antenna_gain_db"}:
            dtype = torch.complex128 if tensors[name].is_complex() else torch.float64
            tensors[name] = tensors[name].detach().to(dtype).requires_grad_()
        self.loss(self.fast(**tensors)).backward()
        return {name: np.asarray(tensor.grad) for name, tensor in tensors.items()}

    def difference(self, name: str, direction: Any, step: float) -> float:
        """Central difference of the twin's loss along a direction of one number."""
        ends = [self.loss(self.exact(**{name: self.numbers[name] + s * direction})) for s in (-step, step)]
        return float(ends[1] - ends[0]) / (2 * step)

    def error(self, name: str, gradient: NDArray[Any], directions: list[Any], step: float) -> float:
        """Of the gradient along some directions, relative to their central differences."""
        told = np.array([(np.conj(gradient) * direction).real.sum() for direction in directions])
        exact = np.array([self.difference(name, direction, step) for direction in directions])
        return float(np.linalg.norm(told - exact) / np.linalg.norm(exact))

    def errors(self, *names: str, places: int = 1) -> dict[str, float]:
        """Relative errors of all gradients asked for.

        Args:
            names: of `numbers`; "vertices" stands for translation, rotation, a random, a smooth motion and single
                vertices, "tx_m" and "rx_m" for single antennas.
            places: how many single vertices, and how many antennas.
        """
        rng, errors = np.random.default_rng(3), {}
        for name, gradient in self.gradients(*names).items():
            if name == "vertices":
                for kind, (directions, step) in self._motions(gradient, rng, places).items():
                    errors[kind] = self.error(name, gradient, directions, step)
            elif name in ("tx_m", "rx_m"):
                chosen = rng.choice(len(gradient), places, replace=False)
                directions = [_at(gradient, row, axis) for row in chosen for axis in range(3)]
                errors[name] = self.error(name, gradient, directions, 10 * STEP_M)
            else:
                step = STEP_M if name.endswith("_m") else STEP
                for part, unit in (("", 1.0), (" imaginary", 1j)):
                    if part == "" or np.iscomplexobj(gradient):
                        errors[name + part] = self.error(name, gradient, [unit], step)
        return errors

    def misses(self, *names: str, places: int = 1) -> dict[str, float]:
        """Those of the `errors` that exceed what is asked for."""
        return {
            name: error
            for name, error in self.errors(*names, places=places).items()
            if not error < ASKED[name.removesuffix(" imaginary")]
        }

    def _motions(
        self, gradient: NDArray[np.float64], rng: np.random.Generator, places: int
    ) -> dict[str, tuple[list[NDArray[np.float64]], float]]:
        at, axes = self.vertices, np.eye(3)
        # off the middle: about its centre a sphere may turn as it likes
        pivot = at.mean(axis=0) + 0.25 * np.ptp(at, axis=0)
        waves = np.sin(at @ rng.normal(size=(3, 3)) * 60)
        strongest = np.argsort(-np.linalg.norm(gradient, axis=1))[:places]
        return {
            "translation": ([np.tile(axis, (len(at), 1)) for axis in axes], STEP_M),
            "rotation": ([np.cross(axis, at - pivot) for axis in axes], 10 * STEP_M),
            "random motion": ([rng.normal(size=at.shape) for _ in range(places)], STEP_M / 10),
            "smooth motion": ([waves], STEP_M / 10),
            "single vertices": ([_at(at, row, axis) for row in strongest for axis in range(3)], 2 * STEP_M),
        }


def turned(vertices: NDArray[np.float64], turn_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vertices (V, 3) turned about their mean."""
    middle = vertices.mean(axis=0)
    return np.asarray((vertices - middle) @ Rotation.from_rotvec(turn_rad).as_matrix().T + middle)


def _at(like: NDArray[np.float64], row: int, axis: int) -> NDArray[np.float64]:
    unit = np.zeros(like.shape)
    unit[row, axis] = 1.0
    return unit


def _silent(walls: dict[str, Any]) -> dict[str, Any]:
    """The same occluders without echoes of their own."""
    return walls | {"sheets": tuple(replace(sheet, echo=False) for sheet in walls["sheets"])}
