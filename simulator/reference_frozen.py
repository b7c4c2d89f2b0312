"""NumPy float64 twin of the differentiable model: the same pieces, seen by the same antennas, summed one by one.

It takes nothing from the kernels but what `differentiable.freeze` found: which faces are cut into which pieces, and the
share of each that an antenna sees. Facing is held, too, as it was where the twin was made. So its signal is smooth in
every number, and its central differences are what the gradients of the differentiable model are tested against.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.box_walls import wall_pieces
from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.plane_image import way_by_plane
from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference_response import pair_response
from waveformer.simulator.response_plan import Crossings, ResponsePlan
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.tessellation import Tessellation

if TYPE_CHECKING:
    from waveformer.simulator.differentiable import FrozenScene
    from waveformer.simulator.frozen_surroundings import FrozenWalls


@dataclass(frozen=True, eq=False)
class FrozenTwin:
    """A frozen scene whose signal is asked for at other vertices, antennas and matter; from `at`.

    Attributes:
        scene: what is discrete.
        shares: for every target of the scene, the share of every piece that an antenna sees, negative where it
            sees the back, shape (N, S).
    """

    scene: FrozenScene
    shares: list[NDArray[np.float64]]

    @classmethod
    def at(cls, scene: FrozenScene, vertices_m: NDArray[np.float64], aperture: Aperture) -> FrozenTwin:
        """Hold facing as it is here.

        Args:
            scene: from `differentiable.freeze`.
            vertices_m: (V, 3).
            aperture: N pairs.
        """
        shares = []
        for target in scene.targets:
            samples = samples_of(target.pieces, scene.faces, vertices_m)
            side = _facing(samples, aperture, target.surface.two_sided)
            shares.append(side * _visible(target.surface.tiles, side.shape))
        return cls(scene, shares)

    def echo(
        self,
        vertices_m: NDArray[np.float64],
        aperture: Aperture,
        material: Material | None = None,
        surroundings: Surroundings | None = None,
    ) -> NDArray[np.complex128]:
        """The signal that `differentiable.simulate` returns for this frozen scene.

        Args:
            vertices_m: (V, 3).
            aperture: N pairs.
            material: of the target; None for a perfect conductor.
            surroundings: antennas and occluders; None for isotropic antennas in the open.

        Returns:
            Shape (N, T), for a reflectivity of 1, no further gain and no range bias.
        """
        chirp, around = self.scene.chirp, surroundings or Surroundings()
        h = np.zeros((len(aperture), chirp.num_samples), dtype=np.complex128)
        for target, shares in zip(self.scene.targets, self.shares, strict=True):
            samples = samples_of(target.pieces, self.scene.faces, vertices_m)
            plan = _everywhere(material or Material.pec(), around, target.surface.crossings)
            taper = self._taper(samples)
            h += _sum(samples, taper, shares, chirp, aperture, plan)
        for wall in self.scene.walls:
            h += _wall_echo(wall, chirp, aperture, around)
        for sheet in around.sheets:
            if sheet.echo:
                h += _sheet_echo(sheet, around, chirp, aperture)
        return h

    def _taper(self, samples: SurfaceSamples) -> NDArray[np.float64]:
        """(2 k)^2 variance / 8 of every piece, (S,)."""
        wavenumber = 2.0 * np.pi * self.scene.chirp.center_hz / SPEED_OF_LIGHT_M_PER_S
        form_factor = float(self.scene.numerics.facet_taper)
        return np.asarray((2.0 * wavenumber) ** 2 * samples.spread_m2 / 8.0 * form_factor)


def samples_of(
    pieces: Tessellation, faces: NDArray[np.int64], vertices_m: NDArray[np.float64]
) -> SurfaceSamples:
    """The pieces (S) of faces (F, 3), where their vertices (V, 3) are now."""
    corners = vertices_m[faces[pieces.face]]  # (S, 3, 3)
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = np.cross(u, v)
    doubled = np.linalg.norm(cross, axis=1)
    products = np.stack([(u * u).sum(axis=1), (u * v).sum(axis=1), (v * v).sum(axis=1)], axis=1)
    return SurfaceSamples(
        points_m=corners[:, 0] + pieces.barycentric[:, :1] * u + pieces.barycentric[:, 1:] * v,
        normals=cross / doubled[:, None],
        areas_m2=0.5 * doubled / pieces.divisor,
        spread_m2=(pieces.spread_form * products).sum(axis=1),
    )


def _facing(samples: SurfaceSamples, aperture: Aperture, two_sided: bool) -> NDArray[np.float64]:
    """1 where both antennas of a pair face a piece, -1 where both see the back of a two-sided one, else 0, (N, S)."""
    heights = [
        np.einsum("sj,nsj->ns", samples.normals, antennas[:, None] - samples.points_m)
        for antennas in (aperture.tx_m, aperture.receivers_m)
    ]
    front = (heights[0] > 0) & (heights[1] > 0)
    back = (heights[0] < 0) & (heights[1] < 0) & two_sided
    return np.asarray(front.astype(np.float64) - back)


def _visible(tiles: tuple[Any, ...], shape: tuple[int, int]) -> NDArray[np.float64]:
    """Share of every piece that an antenna sees, (N, S)."""
    visible = np.zeros(shape)
    for work in tiles:
        seen, rows = work.visibility, work.tile.rows
        visible[np.ix_(rows, seen.lit)] = 1.0
        visible[np.ix_(rows, seen.partial)] = work.tile.ray_weights @ seen.partial_visible
    return visible


def _everywhere(
    material: Material,
    surroundings: Surroundings,
    crossings: Crossings,
    facet_m: NDArray[np.float64] | None = None,
) -> ResponsePlan:
    """What W consists of, to be evaluated at any frequency."""
    nowhere = np.zeros(1), np.zeros((1, 1))
    return ResponsePlan(material, surroundings, crossings, *nowhere, 0.0, facet_m)


def _sum(
    samples: SurfaceSamples,
    taper: NDArray[np.float64],
    shares: NDArray[np.float64],
    chirp: Chirp,
    aperture: Aperture,
    plan: ResponsePlan,
) -> NDArray[np.complex128]:
    """(j / 4 pi) sum W V (cos_i + cos_r) / 2 dA / (R_tx R_rx) exp(-j k (R_tx + R_rx)), (N, T)."""
    h = np.zeros((len(aperture), chirp.num_samples), dtype=np.complex128)
    for row, (tx, rx) in enumerate(zip(aperture.tx_m, aperture.receivers_m, strict=True)):
        seen = np.flatnonzero(shares[row])
        points, normals = samples.points_m[seen], samples.normals[seen]
        ranges = [np.linalg.norm(antenna - points, axis=1) for antenna in (tx, rx)]
        towards = [(antenna - points) / r[:, None] for antenna, r in zip((tx, rx), ranges, strict=True)]
        cosine = 0.5 * ((towards[0] + towards[1]) * normals).sum(axis=1)
        bisector = 0.5 + 0.5 * (towards[0] * towards[1]).sum(axis=1)
        form_factor = (1.0 - taper[seen] * (bisector - cosine**2)) ** 4
        # a share is negative where the back is seen, and so is the cosine
        weight = shares[row, seen] * cosine * samples.areas_m2[seen] / (ranges[0] * ranges[1]) * form_factor
        path = ranges[0] + ranges[1]
        turn = weight * np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_PER_S * chirp.start_hz * path)
        step = np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_PER_S * chirp.bandwidth_hz / chirp.num_samples * path)
        for sample, frequency in enumerate(chirp.frequencies_hz):
            response = _response(plan, float(frequency), points, normals, tx, rx)
            h[row, sample] = 1j / (4.0 * np.pi) * (turn * response).sum()
            turn = turn * step
    return h


def _response(
    plan: ResponsePlan,
    frequency_hz: float,
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64],
) -> NDArray[np.complex128] | float:
    """W of all pieces; a smooth conductor in the open is a mirror, without the detour by way of its matter."""
    around, material = plan.surroundings, plan.material
    bare = not around.occludes and around.antenna.is_isotropic and plan.facet_m is None
    if bare and material.is_conductor and material.roughness_m == 0:
        return -(float(around.antenna.amplitude(np.array([0.0, 0.0, 1.0]))) ** 2)
    return pair_response(plan, frequency_hz, points_m, normals, tx_m, rx_m)


def _wall_echo(
    wall: FrozenWalls, chirp: Chirp, aperture: Aperture, surroundings: Surroundings
) -> NDArray[np.complex128]:
    """Echo of the outer or the inner faces of the box, (N, T); they are flat, so that no facing can change."""
    box = surroundings.box
    assert box is not None
    every, facet_m = wall_pieces(box, 1.0, wall.antennas_m, inside=wall.inside, counts=wall.counts)
    samples = take(every, wall.index)
    plan = _everywhere(box.material, surroundings, wall.surface.crossings, facet_m)
    shape = len(aperture), len(samples.points_m)
    shares = _facing(samples, aperture, False) * _visible(wall.surface.tiles, shape)
    return _sum(samples, np.zeros(len(samples.points_m)), shares, chirp, aperture, plan)


def _sheet_echo(
    sheet: Sheet, surroundings: Surroundings, chirp: Chirp, aperture: Aperture
) -> NDArray[np.complex128]:
    """The echo r lambda / (4 pi L) exp(-j k L) with L the way by the face of an infinite sheet, (N, T)."""
    tx, rx, normal = aperture.tx_m, aperture.receivers_m, np.asarray(sheet.normal)
    length_m, mirror_m = way_by_plane(tx, rx, np.asarray(sheet.point_m), normal)
    others = replace(surroundings, sheets=tuple(other for other in surroundings.sheets if other is not sheet))
    plan = _everywhere(sheet.material, others, "any")
    columns = []
    for frequency in chirp.frequencies_hz:
        wavelength_m = SPEED_OF_LIGHT_M_PER_S / frequency
        mirror = wavelength_m / (4.0 * np.pi * length_m) * np.exp(-2j * np.pi / wavelength_m * length_m)
        columns.append(pair_response(plan, float(frequency), mirror_m, normal, tx, rx) * mirror)
    return np.stack(columns, axis=1)
