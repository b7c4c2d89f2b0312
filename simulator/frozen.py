"""The discrete part of a scene: how surfaces are cut into pieces, and which antenna sees which piece.

Nothing here has a derivative. It is found once by rays and then held, while vertices, antennas and matter move: only
the lengths and amplitudes of the ways that exist are differentiated, not whether they exist.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.clusters import Cells, cell_bounds
from waveformer.simulator.echo_operator import SurfaceEcho
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.factorisation import (
    TileWork,
    plan_cells,
    set_apart,
    tile_work,
    turning_samples,
    uneven_samples,
)
from waveformer.simulator.fast_echo import trace_source
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.placement import place_target
from waveformer.simulator.quadrature import (
    SurfaceSamples,
    face_chunks,
    faces_that_can_face,
    sample_surface,
)
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.response_plan import Crossings, ResponsePlan
from waveformer.simulator.subapertures import move_nodes, node_phase_per_metre
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.target import Target
from waveformer.simulator.tessellation import Tessellation, tessellate


@dataclass(frozen=True, eq=False)
class FrozenSurface:
    """Samples cell by cell, and which tile sees which.

    Attributes:
        starts: first sample of every cell, shape (Q + 1,).
        tiles: every tile of the aperture once.
        two_sided: whether the back of the surface reflects.
        closest_m: smallest distance from an antenna to the target.
        crossings: walls of the box that its ways cross.
        numerics: kernel settings.
    """

    starts: NDArray[np.int64]
    tiles: tuple[TileWork, ...]
    two_sided: bool
    closest_m: float
    crossings: Crossings
    numerics: Numerics

    def echo(
        self,
        samples: SurfaceSamples,
        chirp: Chirp,
        aperture: Aperture,
        response: ResponsePlan | None,
        scale: complex,
    ) -> SurfaceEcho:
        """The echo of these samples where they are now.

        Args:
            samples: in the order of the cells.
            chirp, aperture: the radar, the antennas where they are now.
            response: factor W of a pair; None for 1.
            scale: factor on the sum.
        """
        cells = Cells(
            np.arange(len(samples.points_m)), self.starts, *cell_bounds(samples.points_m, self.starts)
        )
        plan = plan_cells(samples, cells, chirp, self.numerics)
        phase_per_metre = node_phase_per_metre(
            self.closest_m,
            cells.radius_m,
            float(chirp.wavelengths_m[-1]),
            0.0 if response is None else response.phase_per_radian,
        )
        tiles = tuple(
            replace(work, tile=move_nodes(work.tile, aperture, phase_per_metre, self.numerics.tolerance))
            for work in self.tiles
        )
        return SurfaceEcho(plan, tiles, self.two_sided, response, chirp, aperture, scale)


class FrozenTarget(NamedTuple):
    """Some faces of a target.

    Attributes:
        surface: what sees their pieces.
        pieces: the pieces, in the order of the cells.
    """

    surface: FrozenSurface
    pieces: Tessellation


def freeze_target(
    scene: Any,
    mesh: SurfaceMesh,
    chirp: Chirp,
    aperture: Aperture,
    surroundings: Surroundings,
    numerics: Numerics,
) -> list[FrozenTarget]:
    """Cut a target into pieces and trace what each tile of the aperture sees of it.

    Args:
        scene: Mitsuba scene of everything that shadows.
        mesh: in the radar frame.
        chirp, aperture: the radar.
        surroundings: its box decides which pieces are summed antenna by antenna.
        numerics: of the fast kernel.

    Raises:
        MeshError, RadarError: as `simulate`.
    """
    placed = place_target(Target(mesh), surroundings.box, chirp, aperture)
    keep = faces_that_can_face(
        mesh.triangles_m, mesh.normals, mesh.two_sided, aperture.tx_m, aperture.receivers_m
    )
    spacing_m = numerics.spacing_m(float(mesh.areas_m2[keep].sum()), SPEED_OF_LIGHT_M_PER_S / chirp.center_hz)
    targets = []
    for chunk in face_chunks(mesh, keep, spacing_m):
        source = EchoSource(
            sample_surface(mesh, np.eye(4), spacing_m, chunk), mesh.two_sided, placed.closest_m
        )
        frozen = freeze_source(scene, source, chirp, aperture, surroundings, placed.crossings, numerics)
        if frozen is not None:
            surface, index = frozen
            targets.append(FrozenTarget(surface, tessellate(mesh, spacing_m, chunk).take(index)))
    return targets


def freeze_source(
    scene: Any,
    source: EchoSource,
    chirp: Chirp,
    aperture: Aperture,
    surroundings: Surroundings,
    crossings: Crossings,
    numerics: Numerics,
) -> tuple[FrozenSurface, NDArray[np.int64]] | None:
    """What sees the samples of a source, and which of them it is about, cell by cell; None if nothing is seen."""
    traced = trace_source(scene, source, chirp, aperture, numerics)
    if traced is None:
        return None
    plan, index, visibility, tiles = traced
    works = []
    for tile in tiles:
        apart = turning_samples(plan, tile, aperture)
        apart |= uneven_samples(plan, tile, surroundings, crossings, aperture)
        works.append(tile_work(plan, tile, set_apart(visibility.of_tile(tile), apart)))
    surface = FrozenSurface(
        plan.cells.starts, tuple(works), source.two_sided, source.closest_m, crossings, numerics
    )
    return surface, index
