"""What is found once and held: every piece in its cell, every antenna in a tile, the echo that of the fast kernel."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from waveformer.simulator import primitives
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.numerics import DIFFERENTIABLE
from waveformer.simulator.occluders import Box
from waveformer.simulator.quadrature import SurfaceSamples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference_frozen import FrozenTwin, samples_of
from waveformer.simulator.surroundings import Surroundings

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 3.6e9, 8)
GRID = Aperture.planar_grid(6, 6, 0.006)
PAIRS = Aperture(GRID.tx_m, GRID.tx_m + [0.02, -0.01, 0.0])


def ball_over_a_plate() -> SurfaceMesh:
    ball, plate = primitives.sphere(0.004, 0.0015), primitives.plate(0.018, 0.015, 0.003)
    ball.apply_translation([0, 0, 0.008])
    mesh = trimesh.util.concatenate([ball, plate])
    mesh.apply_translation([0.004, 0.002, -0.26])
    return load_mesh(mesh)


def freeze(mesh: SurfaceMesh, aperture: Aperture, surroundings: Surroundings) -> Any:
    from waveformer.simulator.frozen import freeze_target
    from waveformer.simulator.scene import build_scene

    scene = build_scene([(mesh.vertices_m, mesh.faces)])
    (target,) = freeze_target(scene, mesh, CHIRP, aperture, surroundings, DIFFERENTIABLE)
    return target


def samples_at(target: Any, mesh: SurfaceMesh) -> SurfaceSamples:
    return samples_of(target.pieces, mesh.faces, mesh.vertices_m)


@pytest.mark.parametrize("aperture", [GRID, PAIRS], ids=["monostatic", "pairs"])
def test_every_antenna_is_in_one_tile_and_every_piece_in_one_cell(aperture: Aperture) -> None:
    mesh = ball_over_a_plate()
    target = freeze(mesh, aperture, Surroundings())
    surface, samples = target.surface, samples_at(target, mesh)
    rows = np.concatenate([work.tile.rows for work in surface.tiles])
    assert sorted(rows) == list(range(len(aperture)))
    assert (surface.starts[0], surface.starts[-1]) == (0, len(target.pieces))
    edge_m = DIFFERENTIABLE.cell_wavelengths * SPEED_OF_LIGHT_M_PER_S / CHIRP.center_hz
    for first, last in zip(surface.starts[:-1], surface.starts[1:], strict=True):
        assert (np.ptp(samples.points_m[first:last], axis=0) <= edge_m).all()
    for work in surface.tiles:
        assert not set(work.visibility.lit) & set(work.visibility.partial)


def test_pairs_of_which_one_antenna_sets_first_are_summed_alone() -> None:
    mesh = ball_over_a_plate()
    target = freeze(mesh, PAIRS, Surroundings())
    samples = samples_at(target, mesh)
    for work in target.surface.tiles:
        lit = work.visibility.lit
        heights = [
            np.einsum("sj,nsj->ns", samples.normals[lit], antennas[work.tile.rows][:, None] - samples.points_m[lit])
            for antennas in (PAIRS.tx_m, PAIRS.receivers_m)
        ]  # fmt: skip
        signs = np.sign(np.concatenate(heights))
        assert (signs == signs[0]).all()


def test_pieces_seen_through_an_edge_of_the_box_are_summed_alone() -> None:
    mesh = ball_over_a_plate()
    box = Box((-0.012, -0.012, -0.27), (0.018, 0.016, -0.19), 0.003, 2.0)
    wide = Aperture.planar_grid(6, 6, 0.02)
    alone = [
        sum(len(work.visibility.partial) for work in freeze(mesh, wide, Surroundings(box=b)).surface.tiles)
        for b in (None, box)
    ]
    assert alone[1] > alone[0]


@pytest.mark.parametrize("aperture", [GRID, PAIRS], ids=["monostatic", "pairs"])
def test_the_echo_follows_surface_and_antennas(aperture: Aperture) -> None:
    from waveformer.simulator.differentiable import FrozenScene

    mesh = ball_over_a_plate()
    target = freeze(mesh, aperture, Surroundings())
    scene = FrozenScene(mesh.faces, [target], [], CHIRP, DIFFERENTIABLE, {})
    twin = FrozenTwin.at(scene, mesh.vertices_m, aperture)
    moved = mesh.vertices_m + [3e-4, -2e-4, 5e-4]
    jitter = np.random.default_rng(0).normal(size=(len(aperture), 3)) * 1e-4
    antennas = Aperture(aperture.tx_m + jitter, None if aperture.rx_m is None else aperture.rx_m + jitter)
    for vertices, now in ((mesh.vertices_m, aperture), (moved, aperture), (moved, antennas)):
        samples = samples_of(target.pieces, mesh.faces, vertices)
        echo = target.surface.echo(samples, CHIRP, now, None, -1j / (4.0 * np.pi))
        expected = twin.echo(vertices, now)
        # float32 and the tolerance of the interpolations; facing changes for a few pieces of small cosine
        error = np.linalg.norm(echo.value() - expected) / np.linalg.norm(expected)
        assert error < 1e-4


def test_nothing_that_is_seen_is_no_target() -> None:
    from waveformer.simulator.frozen import freeze_target
    from waveformer.simulator.scene import build_scene

    mesh = load_mesh(primitives.box(0.02, 0.02, 0.02, center_m=(0.0, 0.0, -0.3)))
    hidden = SurfaceMesh(mesh.vertices_m, mesh.faces[mesh.normals[:, 2] < 0.5], "bottom", False)
    below = SurfaceMesh(hidden.vertices_m, hidden.faces[hidden.normals[:, 2] < -0.5], "bottom", False)
    scene = build_scene([(mesh.vertices_m, mesh.faces)])
    assert freeze_target(scene, below, CHIRP, GRID, Surroundings(), DIFFERENTIABLE) == []
