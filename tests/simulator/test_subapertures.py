"""Tiles of the aperture: their nodes reproduce what is smooth, and no row is lost."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.radar import Aperture
from waveformer.simulator.subapertures import (
    MAX_TILE_ANGLE_DEG,
    MAX_TILE_POSITIONS,
    Tile,
    build_tiles,
    corner_rows,
    move_nodes,
    node_phase_per_metre,
    probe_rows,
)

WAVELENGTH_M = 0.0037
CLOSEST_M = 0.3
CELL_RADIUS_M = 0.006
LEAF_M = 0.0065
GRID = Aperture.planar_grid(24, 20, 0.004)


def tiles_of(aperture: Aperture, tolerance: float = 1e-3, closest_m: float = CLOSEST_M) -> list[Tile]:
    return build_tiles(aperture, closest_m, CELL_RADIUS_M, WAVELENGTH_M, tolerance, LEAF_M)


def paired(offset_m: np.ndarray) -> Aperture:
    return Aperture(GRID.tx_m, GRID.tx_m + offset_m)


def irregular(rng: np.random.Generator) -> Aperture:
    return Aperture(GRID.tx_m, GRID.tx_m + rng.uniform(-0.02, 0.02, GRID.tx_m.shape) * [1, 1, 0])


@pytest.mark.parametrize("kind", ["monostatic", "equal offset", "two offsets", "irregular"])
def test_the_tiles_hold_every_row_once_and_stay_compact(rng: np.random.Generator, kind: str) -> None:
    two = np.where(np.arange(len(GRID))[:, None] % 2, [0.01, 0, 0], [0, 0.02, 0])
    aperture = {
        "monostatic": GRID,
        "equal offset": paired(np.array([0.01, 0, 0])),
        "two offsets": paired(two),
        "irregular": irregular(rng),
    }[kind]
    tiles = tiles_of(aperture)
    assert sorted(np.concatenate([tile.rows for tile in tiles])) == list(range(len(GRID)))
    middle = 0.5 * (aperture.tx_m + aperture.receivers_m)
    for tile in tiles:
        assert len(tile.rows) <= MAX_TILE_POSITIONS
        assert (np.ptp(middle[tile.rows], axis=0) <= CLOSEST_M * np.radians(MAX_TILE_ANGLE_DEG)).all()


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-5])
def test_the_nodes_reproduce_the_echo_of_a_cell_to_the_tolerance(
    rng: np.random.Generator, tolerance: float
) -> None:
    """exp(-2jk (R_sample - R_center)) seen from the rows, interpolated from the nodes."""
    directions = rng.normal(size=(40, 3))
    for tile in tiles_of(GRID, tolerance):
        assert tile.weights is not None
        center = np.array([0.01, -0.02, -CLOSEST_M - CELL_RADIUS_M])
        for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
            point = center + CELL_RADIUS_M * direction
            rows, nodes = (
                np.exp(
                    -4j * np.pi / WAVELENGTH_M
                    * (np.linalg.norm(at - point, axis=1) - np.linalg.norm(at - center, axis=1))
                )
                for at in (GRID.tx_m[tile.rows], tile.node_tx_m)
            )  # fmt: skip
            # each of two axes errs by the tolerance, the outer one times the inner Lebesgue sum (< 2.5)
            assert np.abs(tile.weights @ nodes - rows).max() < 3.5 * tolerance


def test_fewer_nodes_than_rows_stand_for_a_tile() -> None:
    for tile in tiles_of(GRID):
        assert tile.weights is not None
        assert len(tile.node_tx_m) < 0.5 * len(tile.rows)
        assert tile.weights.shape == (len(tile.rows), len(tile.node_tx_m))
        assert tile.weights.sum(axis=1) == pytest.approx(np.ones(len(tile.rows)), abs=1e-5)  # float32


def test_a_tight_tolerance_makes_every_row_its_own_node() -> None:
    aperture = Aperture.planar_grid(3, 3, 0.004)
    (tile,) = tiles_of(aperture, 1e-9)
    assert tile.weights is None
    assert (tile.node_tx_m == aperture.tx_m[tile.rows]).all()


def test_monostatic_nodes_have_no_receivers() -> None:
    assert all(tile.node_rx_m is None and tile.ray_rx_m is None for tile in tiles_of(GRID))


def test_pairs_of_equal_offset_share_nodes_that_keep_the_offset() -> None:
    offset = np.array([0.012, -0.004, 0.0])
    for tile in tiles_of(paired(offset)):
        assert tile.weights is not None
        assert tile.node_rx_m is not None
        assert tile.ray_rx_m is not None
        assert len(tile.node_tx_m) < len(tile.rows)
        assert tile.node_rx_m - tile.node_tx_m == pytest.approx(np.tile(offset, (len(tile.node_tx_m), 1)))
        assert tile.ray_rx_m - tile.ray_tx_m == pytest.approx(np.tile(offset, (len(tile.ray_tx_m), 1)))
        # linear functions of the transmitter's position come back from the nodes
        assert tile.weights @ tile.node_tx_m == pytest.approx(GRID.tx_m[tile.rows], abs=1e-6)  # float32


def test_two_interleaved_offsets_do_not_share_a_tile() -> None:
    offsets = np.where(np.arange(len(GRID))[:, None] % 2, [0.01, 0, 0], [0, 0.02, 0])
    for tile in tiles_of(paired(offsets)):
        assert len(np.unique(tile.rows % 2)) == 1


def test_irregular_pairs_fall_back_to_their_own_rows(rng: np.random.Generator) -> None:
    aperture = irregular(rng)
    for tile in tiles_of(aperture):
        assert tile.weights is None
        assert (tile.node_tx_m == aperture.tx_m[tile.rows]).all()
        assert tile.node_rx_m is not None
        assert (tile.node_rx_m == aperture.receivers_m[tile.rows]).all()
        assert (tile.ray_tx_m == tile.node_tx_m).all()
        assert (tile.ray_weights == np.eye(len(tile.rows))).all()


@pytest.mark.parametrize("offset_m", [None, [0.01, 0.0, 0.0]])
def test_ray_weights_are_linear_interpolation_between_rays_close_enough(offset_m: list[float] | None) -> None:
    aperture = GRID if offset_m is None else paired(np.array(offset_m))
    for tile in tiles_of(aperture):
        assert (tile.ray_weights >= 0).all()
        assert tile.ray_weights.sum(axis=1) == pytest.approx(np.ones(len(tile.rows)), abs=1e-6)  # float32
        assert tile.ray_weights @ tile.ray_tx_m == pytest.approx(
            aperture.tx_m[tile.rows], abs=1e-7
        )  # float32
        for axis in range(2):
            assert np.diff(np.unique(tile.ray_tx_m[:, axis].round(9))).max() <= LEAF_M * (1 + 1e-9)


def test_rays_are_interpolated_to_the_nodes_where_these_lie() -> None:
    """Linear weights give back any linear function, so the nodes' own places."""
    aperture = Aperture.planar_grid(31, 41, 0.004)
    tiles = [tile for tile in tiles_of(aperture) if tile.ray_shape is not None and tile.weights is not None]
    assert tiles
    for tile in tiles:
        weights = tile.node_ray_weights
        # within the box of the rays; 1e-6 is float32
        low, high = tile.ray_tx_m.min(axis=0), tile.ray_tx_m.max(axis=0)
        inside = ((tile.node_tx_m > low - 1e-9) & (tile.node_tx_m < high + 1e-9)).all(axis=1)
        assert inside.any()
        np.testing.assert_allclose((weights @ tile.ray_tx_m)[inside], tile.node_tx_m[inside], atol=1e-6)


@pytest.mark.parametrize("most", [1, 7, 50, 10_000, None])
@pytest.mark.parametrize("is_irregular", [False, True])
def test_splitting_a_tile_keeps_rows_nodes_and_weights(
    rng: np.random.Generator, most: int | None, is_irregular: bool
) -> None:
    tile = tiles_of(irregular(rng) if is_irregular else GRID)[0]
    parts = tile.split(most)
    assert max(len(part.rows) for part in parts) <= (most or len(tile.rows))
    assert (np.concatenate([part.rows for part in parts]) == tile.rows).all()
    assert (np.concatenate([part.ray_weights for part in parts]) == tile.ray_weights).all()
    assert all(part.node_tx_m is tile.node_tx_m for part in parts)
    whole = np.eye(len(tile.rows)) if tile.weights is None else tile.weights
    if len(parts) > 1:
        assert all(part.weights is not None for part in parts)
        assert (np.concatenate([part.weights for part in parts]) == whole).all()


def test_probes_are_rows_with_one_of_them_near_every_position() -> None:
    spacing_m = 0.03
    rows = probe_rows(GRID, spacing_m)
    assert (np.diff(rows) > 0).all()
    assert len(rows) < len(GRID) / 8
    distance = np.linalg.norm(GRID.tx_m[:, None] - GRID.tx_m[rows], axis=2).min(axis=1)
    assert distance.max() <= spacing_m / np.sqrt(2) + 0.004  # half a group's diagonal, and one pitch
    corners = [0, 23, 19 * 24, 19 * 24 + 23]
    assert set(corners) <= set(rows)


def test_corner_rows_of_a_single_position_and_of_a_line() -> None:
    assert corner_rows(np.zeros((1, 3))).tolist() == [0]
    line = np.zeros((5, 3))
    line[:, 0] = np.arange(5)
    assert corner_rows(line).tolist() == [0, 2, 4]


PHASE_PER_METRE = node_phase_per_metre(CLOSEST_M, CELL_RADIUS_M, WAVELENGTH_M, 0.0)


def same_nodes(one: Tile, other: Tile) -> bool:
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("rows", "node_tx_m", "node_rx_m", "weights", "ray_tx_m", "ray_rx_m", "ray_weights")
    )


@pytest.mark.parametrize("kind", ["monostatic", "equal offset", "irregular"])
def test_antennas_that_do_not_move_keep_their_nodes(rng: np.random.Generator, kind: str) -> None:
    aperture = {
        "monostatic": GRID,
        "equal offset": paired(np.array([0.25, 0, 0])),  # an offset that floating point holds exactly
        "irregular": irregular(rng),
    }[kind]
    for tile in tiles_of(aperture):
        moved = move_nodes(tile, aperture, PHASE_PER_METRE, 1e-3)
        if (
            kind == "equal offset"
        ):  # the mean of the offsets and their rounded value differ in the last digits
            assert moved.node_tx_m == pytest.approx(tile.node_tx_m, abs=1e-9)
            assert moved.weights == pytest.approx(tile.weights, abs=1e-6)
        else:
            assert same_nodes(moved, tile)


@pytest.mark.parametrize("offset_m", [None, [0.012, -0.004, 0.0]])
def test_nodes_follow_antennas_that_leave_their_grid(
    rng: np.random.Generator, offset_m: list[float] | None
) -> None:
    tolerance, aperture = 1e-3, GRID if offset_m is None else paired(np.array(offset_m))
    jitter = rng.normal(size=GRID.tx_m.shape) * 5e-4
    now = Aperture(aperture.tx_m + jitter, None if aperture.rx_m is None else aperture.rx_m + jitter)
    center = np.array([0.01, -0.02, -CLOSEST_M - CELL_RADIUS_M])
    for tile in tiles_of(aperture, tolerance):
        moved = move_nodes(tile, now, PHASE_PER_METRE, tolerance)
        assert moved.weights is not None
        assert (moved.rows == tile.rows).all()
        assert moved.ray_weights is tile.ray_weights
        point = center + CELL_RADIUS_M * np.array([0.6, -0.5, 0.6])

        def phase(tx: np.ndarray, rx: np.ndarray, point: np.ndarray = point) -> np.ndarray:
            ways = [
                np.linalg.norm(at - point, axis=1) - np.linalg.norm(at - center, axis=1) for at in (tx, rx)
            ]
            return np.exp(-2j * np.pi / WAVELENGTH_M * (ways[0] + ways[1]))

        nodes = phase(moved.node_tx_m, moved.node_tx_m if moved.node_rx_m is None else moved.node_rx_m)
        rows = phase(now.tx_m[tile.rows], now.receivers_m[tile.rows])
        # as for the tiles themselves, now along three axes
        assert np.abs(moved.weights @ nodes - rows).max() < 10 * tolerance


def test_pairs_that_move_apart_become_their_own_nodes(rng: np.random.Generator) -> None:
    aperture = paired(np.array([0.012, 0.0, 0.0]))
    now = Aperture(aperture.tx_m, aperture.receivers_m + rng.normal(size=GRID.tx_m.shape) * 1e-4)
    for tile in tiles_of(aperture):
        moved = move_nodes(tile, now, PHASE_PER_METRE, 1e-3)
        assert moved.weights is None
        assert (moved.node_tx_m == now.tx_m[tile.rows]).all()
        assert moved.node_rx_m is not None
        assert (moved.node_rx_m == now.receivers_m[tile.rows]).all()
