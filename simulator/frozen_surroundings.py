"""The echo of a box's walls and of sheets for the differentiable model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.box_walls import wall_pieces
from waveformer.simulator.echo_operator import SurfaceEcho
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.frozen import FrozenSurface, freeze_source
from waveformer.simulator.matter_parameters import changed
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.placement import check_box
from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.response_plan import Crossings, WallChange, plan_response
from waveformer.simulator.sheet_echo import sheet_echo
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.tangent_echo import Direction

# Differences in float64 of the closed form of a sheet: truncation and rounding both below 1e-6.
_STEP_M, _STEPS_OF_MATTER = 1e-6, 0.1
# Interpolation over the band, far below what these steps change.
_SHEET_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class FrozenWalls:
    """The outer or the inner faces of a box.

    Attributes:
        surface: what sees their rectangles.
        index: which of all rectangles it holds, in the order of the cells.
        inside: whether they are the inner faces.
        counts: rectangles along x, y and z, shape (3,).
        antennas_m: positions that decided which faces are looked at, shape (A, 3).
    """

    surface: FrozenSurface
    index: NDArray[np.int64]
    inside: bool
    counts: NDArray[np.int64]
    antennas_m: NDArray[np.float64]

    def echo(
        self,
        surroundings: Surroundings,
        chirp: Chirp,
        aperture: Aperture,
        changes: list[WallChange],
    ) -> SurfaceEcho:
        """The echo of these faces for the present matter and antennas.

        Args:
            surroundings: with the box.
            chirp, aperture: the radar.
            changes: numbers by which it will be differentiated.
        """
        assert surroundings.box is not None
        samples, facet_m = self._samples(surroundings)
        neighbours = [changed(surroundings.box.material, surroundings, change)[1] for change in changes]
        response = plan_response(
            surroundings.box.material, surroundings, self.surface.crossings, chirp, self.surface.numerics.tolerance,
            np.array([surroundings.box.min_m, surroundings.box.max_m]),
            np.concatenate([aperture.tx_m, aperture.receivers_m]), facet_m,
            [(_wall_material(near), near) for near in neighbours],
        )  # fmt: skip
        response = replace(
            response,
            surface_wall=len(surroundings.sheets),
            facet_growth=-2.0 / self.counts if self.inside else None,
        )
        term = self.surface.echo(samples, chirp, aperture, response, 1j / (4.0 * np.pi))
        return replace(term, matter_moves=lambda direction: self._moves(surroundings, direction))

    def _samples(self, surroundings: Surroundings) -> tuple[SurfaceSamples, NDArray[np.float64]]:
        assert surroundings.box is not None
        samples, facet_m = wall_pieces(
            surroundings.box, 1.0, self.antennas_m, inside=self.inside, counts=self.counts
        )
        return take(samples, self.index), facet_m

    def _moves(self, surroundings: Surroundings, direction: Direction) -> NDArray[np.float64] | None:
        """The inner faces move as the walls get thicker."""
        change = WallChange(len(surroundings.sheets), "thickness")
        rate = dict(direction.matter).get(change, 0.0)
        if not self.inside or rate == 0.0:
            return None
        assert surroundings.box is not None
        _, thicker, step = changed(surroundings.box.material, surroundings, change)
        near, far = self._samples(surroundings)[0], self._samples(thicker)[0]
        moved = [far.points_m - near.points_m, far.normals - near.normals]
        moved += [(far.areas_m2 - near.areas_m2)[:, None], np.zeros((len(near.points_m), 1))]
        return np.concatenate(moved, axis=1) * (rate / step)


def freeze_walls(
    scene: Any, chirp: Chirp, aperture: Aperture, surroundings: Surroundings, numerics: Numerics
) -> list[FrozenWalls]:
    """Cut the faces of a box into rectangles and trace what sees them; arguments as in `freeze_target`."""
    box = surroundings.box
    if box is None:
        return []
    antennas = np.concatenate([aperture.tx_m, aperture.receivers_m])
    edge_m = numerics.facet_wavelengths * SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    closest_m = check_box(box, chirp, aperture)
    walls = []
    for inside in (False, True):
        samples, facet_m = wall_pieces(box, edge_m, antennas, inside=inside)
        if len(samples.points_m) == 0:
            continue
        inset = 2.0 * box.thickness_m if inside else 0.0
        counts = np.round((np.asarray(box.max_m) - np.asarray(box.min_m) - inset) / facet_m).astype(np.int64)
        crossings: Crossings = "leaving" if inside else "none"
        source = EchoSource(samples, False, closest_m)
        frozen = freeze_source(scene, source, chirp, aperture, surroundings, crossings, numerics)
        if frozen is not None:
            walls.append(FrozenWalls(*frozen, inside, counts, antennas))
    return walls


@dataclass(frozen=True, eq=False)
class SheetEcho:
    """The echo of a sheet, a closed form in float64 that is differentiated by central differences.

    Attributes:
        place: which of the sheets.
        surroundings: all of them.
        chirp, aperture: the radar.
    """

    place: int
    surroundings: Surroundings
    chirp: Chirp
    aperture: Aperture

    def value(self) -> NDArray[np.complex64]:
        """The echo, shape (N, T)."""
        return self._at(self.surroundings, self.aperture).astype(np.complex64)

    def derivative(self, direction: Direction) -> NDArray[np.complex64]:
        """Its derivative along a direction, shape (N, T)."""
        ends = (self._at(self.surroundings, self._moved(direction, step)) for step in (-_STEP_M, _STEP_M))
        behind, ahead = ends
        total = (ahead - behind) / (2.0 * _STEP_M)
        for change, rate in direction.matter:
            if change.wall is not None:
                total += rate * self._by_matter(change)
        return total.astype(np.complex64)

    def _by_matter(self, change: WallChange) -> NDArray[np.complex128]:
        """One-sided and of second order: matter without loss cannot have less."""
        wall = self.surroundings.sheets[0].material  # not looked at: the change names a wall
        values = [self._at(self.surroundings, self.aperture)]
        step = 0.0
        for steps in (_STEPS_OF_MATTER, 2.0 * _STEPS_OF_MATTER):
            _, surroundings, moved = changed(wall, self.surroundings, change, steps)
            step = step or moved
            values.append(self._at(surroundings, self.aperture))
        return np.asarray((-3.0 * values[0] + 4.0 * values[1] - values[2]) / (2.0 * step))

    def sample_gradient(self, gradient: NDArray[np.complex64]) -> NDArray[np.float64]:
        """A sheet has no samples."""
        return np.zeros((0, 8))

    def _moved(self, direction: Direction, step: float) -> Aperture:
        tx, rx = self.aperture.tx_m, self.aperture.rx_m
        if direction.transmitters_m is not None:
            tx = tx + step * direction.transmitters_m
        if direction.receivers_m is not None and rx is not None:
            rx = rx + step * direction.receivers_m
        return Aperture(tx, rx)

    def _at(self, surroundings: Surroundings, aperture: Aperture) -> NDArray[np.complex128]:
        sheet = surroundings.sheets[self.place]
        return sheet_echo(sheet, surroundings, self.chirp, aperture, _SHEET_TOLERANCE)


def _wall_material(surroundings: Surroundings) -> Any:
    assert surroundings.box is not None
    return surroundings.box.material
