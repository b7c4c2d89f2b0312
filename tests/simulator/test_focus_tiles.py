"""Sub-apertures: every antenna once, and nodes that interpolate what they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator import Aperture
from waveformer.simulator.focus_tiles import FocusTile, focus_tiles

RASTER = Aperture.planar_grid(30, 40, 0.008)
CLOSEST_M, RADIUS_M, WAVELENGTH_M, TOLERANCE = 0.3, 0.008, 3.8e-3, 0.1


def response(tile: FocusTile, center: np.ndarray, voxel: np.ndarray, sides: list[np.ndarray]) -> np.ndarray:
    """Echo of a voxel, freed of the carrier to the centre of its cell."""
    excess = np.mean(
        [np.linalg.norm(s - voxel, axis=1) - np.linalg.norm(s - center, axis=1) for s in sides], 0
    )
    return np.exp(4j * np.pi / WAVELENGTH_M * excess)


@pytest.mark.parametrize("offset_m", [None, 0.01, 0.1])
def test_nodes_stand_for_their_antennas(offset_m: float | None, rng: np.random.Generator) -> None:
    tx = RASTER.tx_m
    rx = None if offset_m is None else tx + np.array([offset_m, 0.0, 0.0])
    tiles = focus_tiles(Aperture(tx, rx), CLOSEST_M, RADIUS_M, WAVELENGTH_M, TOLERANCE)
    assert np.array_equal(np.sort(np.concatenate([tile.rows for tile in tiles])), np.arange(len(tx)))
    assert {len(tile.nodes_m) for tile in tiles} == ({2} if offset_m == 0.1 else {1})
    center = np.array([0.05, -0.02, -0.32])
    for tile in tiles:
        assert tile.weights is not None
        assert len(tile.nodes_m[0]) < len(tile.rows)
        for direction in rng.standard_normal((8, 3)):
            voxel = center + RADIUS_M * direction / np.linalg.norm(direction)
            antennas = [tx[tile.rows]] if rx is None else [tx[tile.rows], rx[tile.rows]]
            exact = response(tile, center, voxel, antennas)
            interpolated = tile.weights @ response(tile, center, voxel, tile.nodes_m)
            # the tolerance once for each of two axes; closely spaced pairs as one antenna once more
            assert np.abs(interpolated - exact).max() < 3 * TOLERANCE


def test_pairs_without_a_common_offset_are_their_own_nodes(rng: np.random.Generator) -> None:
    tx = RASTER.tx_m[:50]
    rx = tx + rng.uniform(-0.2, 0.2, tx.shape)
    for tile in focus_tiles(Aperture(tx, rx), CLOSEST_M, RADIUS_M, WAVELENGTH_M, TOLERANCE):
        assert tile.weights is None
        assert np.array_equal(tile.nodes_m[0], tx[tile.rows])
        assert np.array_equal(tile.nodes_m[1], rx[tile.rows])
