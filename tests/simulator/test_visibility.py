"""Visibility per tile stands for visibility per antenna position."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.fast_echo import PATCH_WAVELENGTHS
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.numerics import FAST
from waveformer.simulator.quadrature import SurfaceSamples, sample_surface
from waveformer.simulator.radar import Aperture
from waveformer.simulator.scene import BACK_FACING, VISIBLE, SampleTable, build_scene, sample_states
from waveformer.simulator.subapertures import Tile, build_tiles
from waveformer.simulator.visibility import GRAZING_COSINE, VisibilityMap

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CLOSEST_M, WAVELENGTH_M = 0.3, 0.0038
GRID = Aperture.planar_grid(12, 12, 0.014)
PAIRS = Aperture(GRID.tx_m, GRID.tx_m + [0.02, 0.0, 0.0])


def setting(mesh: Any, aperture: Aperture) -> tuple[Any, SurfaceSamples, VisibilityMap, list[Tile]]:
    """Scene, samples, map and tiles, with the settings of the fast mode."""
    surface = load_mesh(mesh)
    samples = sample_surface(surface, np.eye(4), WAVELENGTH_M / 3)
    scene = build_scene([(surface.vertices_m, surface.faces)])
    return scene, samples, map_of(scene, samples, surface.two_sided, aperture), tiles_of(aperture)


def map_of(scene: Any, samples: SurfaceSamples, two_sided: bool, aperture: Aperture) -> VisibilityMap:
    spacing_m = CLOSEST_M * np.radians(FAST.probe_spacing_deg)
    patch_m = PATCH_WAVELENGTHS * WAVELENGTH_M
    return VisibilityMap(scene, samples, two_sided, aperture, probe_spacing_m=spacing_m, patch_m=patch_m)


def tiles_of(aperture: Aperture) -> list[Tile]:
    leaf_m = CLOSEST_M * np.radians(FAST.leaf_spacing_deg)
    return build_tiles(aperture, CLOSEST_M, 0.006, WAVELENGTH_M, FAST.tolerance, leaf_m)


def lying_mug() -> Any:
    mesh = primitives.mug(0.004)
    mesh.apply_transform([[0, 0, 1, -0.04], [0, 1, 0, 0], [-1, 0, 0, -0.36], [0, 0, 0, 1]])
    return mesh


@pytest.mark.parametrize("aperture", [GRID, PAIRS], ids=["monostatic", "pairs"])
def test_on_a_mug_tiles_see_what_their_positions_see(aperture: Aperture) -> None:
    scene, samples, seen, tiles = setting(lying_mug(), aperture)
    wrong = facing_pairs = blocked_pairs = 0.0
    for tile in tiles:
        receivers = None if aperture.rx_m is None else aperture.rx_m[tile.rows]
        states = sample_states(
            scene, SampleTable(samples.points_m, samples.normals), False, aperture.tx_m[tile.rows], receivers
        )
        of_tile = seen.of_tile(tile)
        predicted = np.zeros(states.shape)
        predicted[:, of_tile.lit] = 1.0
        predicted[:, of_tile.partial] = tile.ray_weights @ of_tile.partial_visible
        facing = states != BACK_FACING
        wrong += np.abs(predicted - (states == VISIBLE))[facing].sum()
        facing_pairs += facing.sum()
        blocked_pairs += (facing & (states != VISIBLE)).sum()
    assert blocked_pairs / facing_pairs > 0.1  # the mug does shadow itself
    # only samples near a shadow's edge may differ: within a patch, or where it moves between two rays
    assert wrong / facing_pairs < 0.005


def test_lit_and_partial_samples_are_disjoint_and_increasing() -> None:
    _, _, seen, tiles = setting(lying_mug(), GRID)
    for tile in tiles:
        of_tile = seen.of_tile(tile)
        assert (np.diff(of_tile.lit) > 0).all()
        assert (np.diff(of_tile.partial) > 0).all()
        assert not np.intersect1d(of_tile.lit, of_tile.partial).size
        assert of_tile.partial_visible.shape == (len(tile.ray_tx_m), len(of_tile.partial))
        assert (of_tile.partial_visible >= 0).all()
        assert (of_tile.partial_visible <= 1).all()
        assert of_tile.partial_visible.any(axis=0).all()


def test_a_convex_object_has_no_partly_lit_samples() -> None:
    mesh = primitives.sphere(0.04, 0.01)
    mesh.apply_translation([0, 0, -0.34])
    _, samples, seen, tiles = setting(mesh, GRID)
    towards = (GRID.tx_m[:, None] - samples.points_m) * samples.normals
    faces = towards.sum(axis=2) > 1e-4  # metres, below 0.02 degrees
    lost = 0
    for tile in tiles:
        of_tile = seen.of_tile(tile)
        assert len(of_tile.partial) == 0
        lost += np.setdiff1d(np.flatnonzero(faces[tile.rows].any(axis=0)), of_tile.lit).size
    # antennas look from within 6 degrees of a probe, so that the rim of the lit cap may be missed
    assert lost < 0.03 * len(tiles) * faces.any(axis=0).sum()
    assert (seen.seen & faces.any(axis=0)).sum() > 0.97 * faces.any(axis=0).sum()


def test_selecting_samples_selects_their_visibility(rng: np.random.Generator) -> None:
    _, samples, seen, tiles = setting(lying_mug(), GRID)
    index = np.sort(rng.choice(len(samples.points_m), 400, replace=False))
    chosen = seen.select(index)
    assert (chosen.seen == seen.seen[index]).all()
    whole, part = seen.of_tile(tiles[0]), chosen.of_tile(tiles[0])
    assert (index[part.lit] == np.intersect1d(whole.lit, index)).all()
    assert (index[part.partial] == np.intersect1d(whole.partial, index)).all()


def test_a_wall_cuts_the_aperture_in_two() -> None:
    """A plate standing upright over a floor: floor samples see one side of the aperture each."""
    floor = primitives.plate(0.2, 0.2, 0.01, center_m=(0, 0, -0.5))
    wall = primitives.plate(1.0, 1.0)
    wall.apply_transform([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0.0], [0, 0, 0, 1]])  # the plane x = 0
    surface = load_mesh(floor)
    samples = sample_surface(surface, np.eye(4), 0.01)
    scene = build_scene([(surface.vertices_m, surface.faces), (wall.vertices, wall.faces)])
    seen = map_of(scene, samples, True, GRID)
    for tile in tiles_of(GRID):
        lit = np.zeros(len(samples.points_m), dtype=bool)
        lit[seen.of_tile(tile).lit] = True
        tile_x = GRID.tx_m[tile.rows, 0]
        if tile_x.min() * tile_x.max() > 0:  # a tile on one side of the wall
            floor_x = samples.points_m[:, 0] * np.sign(tile_x[0])
            assert lit[floor_x > 1e-3].all()
            assert not lit[floor_x < -1e-3].any()


def test_between_disagreeing_corners_the_lattice_is_traced_not_filled() -> None:
    _, _samples, seen, tiles = setting(lying_mug(), GRID)
    filled = shadow_edges = 0
    for tile in tiles:
        if tile.ray_shape is None or max(tile.ray_shape) < 3:
            continue
        partial = seen.of_tile(tile).partial
        if len(partial) == 0:
            continue
        partial = partial[seen._cosine(tile, partial) > GRAZING_COSINE]
        every = seen._trace(tile.ray_tx_m, tile.ray_rx_m, partial) == VISIBLE
        lattice, _ = seen._trace_lattice(tile, tile.ray_shape, partial)
        filled += int((lattice != every).sum())
        shadow_edges += int((every != every[:1]).sum())
    assert shadow_edges > 1000
    # 0.7 % measured, from samples that share a ray; filling every cell from its corners is wrong for 15 %
    assert filled < 0.02 * shadow_edges


def test_every_sample_of_a_ball_that_faces_the_tile_is_lit() -> None:
    ball = primitives.sphere(0.02, 0.001)
    ball.apply_translation([0.0, 0.0, -0.32])
    _, samples, seen, tiles = setting(ball, GRID)
    for tile in tiles:
        of_tile = seen.of_tile(tile)
        known = np.zeros(len(samples.points_m), dtype=bool)
        known[of_tile.lit], known[of_tile.partial] = True, True
        heights = (samples.points_m * samples.normals).sum(axis=1)
        facing = (GRID.tx_m[tile.rows] @ samples.normals.T > heights).any(axis=0)
        # nothing stands before a ball: also what only the tile's rim faces, which no probe may do, echoes
        assert (facing & ~known).sum() <= 1e-3 * facing.sum()


def test_where_a_surface_grazes_shadow_edges_are_interpolated_without_bias() -> None:
    _, _samples, seen, tiles = setting(lying_mug(), GRID)
    error = shadow_edges = 0.0
    interpolated = 0
    for tile in tiles:
        if tile.ray_shape is None or max(tile.ray_shape) < 3:
            continue
        partial = seen.of_tile(tile).partial
        partial = partial[seen._cosine(tile, partial) <= GRAZING_COSINE]
        every = seen._trace(tile.ray_tx_m, tile.ray_rx_m, partial) == VISIBLE
        lattice, _ = seen._trace_lattice(tile, tile.ray_shape, partial)
        interpolated += int(((lattice > 0) & (lattice < 1)).sum())
        error += float((lattice - every).sum())
        shadow_edges += float((every != every[:1]).sum())
    assert shadow_edges > 500
    assert interpolated > 50
    # 3 % measured, from samples that share the rays of the coarse positions
    assert abs(error) < 0.05 * shadow_edges
