"""Imaging at scale against sums written out in float64."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from waveformer.simulator import Aperture, Chirp, Grid, Measurement, RadarError, simulate_points
from waveformer.simulator.focusing import Focus, focus
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S
from waveformer.simulator.reference_focus import dense_focus

CHIRP = Chirp(77.5001e9, 3.0009e9, 32)
RASTER = Aperture.planar_grid(20, 24, 0.008)
GRID = Grid.box((-0.02, -0.015, -0.36), (0.022, 0.014, -0.33), 0.003)
CUBE = np.array([[0.0, 0.0, -0.345], [0.012, -0.006, -0.352], [-0.015, 0.01, -0.337], [0.006, 0.009, -0.34]])


def assert_close(found: Focus, expected: Focus) -> None:
    strong = np.abs(expected.image) > 0.2 * np.abs(expected.image).max()
    error = np.abs(found.image - expected.image)[strong] / np.abs(expected.image)[strong]
    assert error.max() < 0.02  # what the docstring's bounds leave for voxels this strong
    assert found.normals is not None
    assert expected.normals is not None
    cosine = (found.normals * expected.normals).sum(axis=-1)[strong]
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 1.0


@pytest.fixture(scope="module")
def scan() -> Measurement:
    return simulate_points(CUBE, np.array([1.0, 0.6, 0.8, 0.4]) * 1e-3, CHIRP, RASTER)


@pytest.fixture(scope="module")
def expected(scan: Measurement) -> Focus:
    return dense_focus(scan, GRID)


def test_monostatic(mitsuba_variant: None, scan: Measurement, expected: Focus) -> None:
    assert_close(focus(scan, GRID), expected)


@pytest.mark.parametrize("offset_m", [0.008, 0.12])
def test_pairs(mitsuba_variant: None, offset_m: float) -> None:
    """Close pairs count as one antenna, wide ones do not; several receivers interleave."""
    tx = np.repeat(RASTER.tx_m, 2, axis=0)
    rx = tx + np.tile([[-offset_m, 0.0, 0.0], [-0.5 * offset_m, 0.3 * offset_m, 0.0]], (len(RASTER), 1))
    pairs = simulate_points(CUBE, np.full(4, 1e-3), CHIRP, Aperture(tx, rx))
    assert_close(focus(pairs, GRID), dense_focus(pairs, GRID))


def test_antennas_out_of_a_plane(mitsuba_variant: None, rng: np.random.Generator) -> None:
    tx = RASTER.tx_m + rng.uniform(-0.02, 0.02, (len(RASTER), 3))
    bent = simulate_points(CUBE, np.full(4, 1e-3), CHIRP, Aperture(tx))
    assert_close(focus(bent, GRID), dense_focus(bent, GRID))


def test_pairs_without_a_common_offset(mitsuba_variant: None, rng: np.random.Generator) -> None:
    tx = RASTER.tx_m[:100]
    wild = simulate_points(CUBE, np.full(4, 1e-3), CHIRP, Aperture(tx, tx + rng.uniform(-0.1, 0.1, (100, 3))))
    assert_close(focus(wild, GRID), dense_focus(wild, GRID))


def test_known_bias_is_taken_out(mitsuba_variant: None, scan: Measurement, expected: Focus) -> None:
    turns = scan.chirp.frequencies_hz * 0.15 / SPEED_OF_LIGHT_M_PER_S
    late = Measurement(scan.h * np.exp(-2j * np.pi * turns), CHIRP, RASTER, range_bias_m=0.15)
    assert_close(focus(late, GRID), expected)


@pytest.mark.parametrize(
    ("x", "y", "z"),
    [
        (GRID.x, GRID.y, np.array([-0.345])),
        (np.array([0.0]), np.array([0.0]), np.arange(-0.36, -0.33, 0.0005)),
        (GRID.x[:3], GRID.y, np.array([-0.36, -0.355, -0.3475, -0.345, -0.33])),
    ],
    ids=["layer", "fine column", "uneven"],
)
def test_grids_of_any_shape(
    mitsuba_variant: None,
    scan: Measurement,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    z: NDArray[np.float64],
) -> None:
    grid = Grid(x, y, z)
    assert_close(focus(scan, grid), dense_focus(scan, grid))


@pytest.mark.parametrize("cells_per_edge", [1, 2])
def test_blocks_do_not_show(
    mitsuba_variant: None, scan: Measurement, expected: Focus, cells_per_edge: int
) -> None:
    """Each block places its nodes for its own distance, so blocks differ by the error of the nodes."""
    assert_close(focus(scan, GRID, cells_per_edge=cells_per_edge), expected)


def test_only_wanted_cells_are_formed(mitsuba_variant: None, scan: Measurement) -> None:
    whole = focus(scan, GRID)
    where = np.zeros(GRID.shape, dtype=bool)
    where[2, 3, 1] = where[-1, -1, -1] = True
    part = focus(scan, GRID, where=where)
    formed = part.image != 0.0
    assert formed[where].all()
    assert 0.01 < formed.mean() < 0.5
    # nodes for a smaller block: their error again, relative to the largest value
    assert np.abs(part.image - whole.image)[formed].max() < 0.01 * np.abs(whole.image).max()
    assert part.normals is not None
    assert np.array_equal(np.isfinite(part.normals).all(axis=-1), formed)
    nothing = focus(scan, GRID, where=np.zeros(GRID.shape, dtype=bool))
    assert not nothing.image.any()


def test_normals_are_left_out_on_request(mitsuba_variant: None, scan: Measurement) -> None:
    plain = focus(scan, GRID, normals=False)
    assert plain.normals is None
    assert np.allclose(plain.image, focus(scan, GRID).image, rtol=1e-4, atol=1e-4 * np.abs(plain.image).max())


def test_a_silent_scan_has_no_normals(mitsuba_variant: None, scan: Measurement) -> None:
    silent = focus(Measurement(np.zeros_like(scan.h), CHIRP, RASTER), GRID)
    assert not silent.image.any()
    assert silent.normals is not None
    assert np.isnan(silent.normals).all()


def test_progress_ends_with_all_blocks(mitsuba_variant: None, scan: Measurement) -> None:
    seen: list[tuple[int, int]] = []
    focus(scan, GRID, cells_per_edge=2, progress=lambda done, of: seen.append((done, of)))
    assert seen[-1][0] == seen[-1][1] == len(seen)


def test_bad_input_is_refused(scan: Measurement) -> None:
    h = scan.h.copy()
    h[3, 1] = np.nan
    with pytest.raises(RadarError, match="non-finite"):
        focus(Measurement(h, CHIRP, RASTER), GRID)
    with pytest.raises(RadarError, match="where has shape"):
        focus(scan, GRID, where=np.ones((2, 2, 2), dtype=bool))


def test_the_number_of_threads_does_not_show(tmp_path) -> None:
    program = """
import sys, numpy as np
from waveformer.simulator import Aperture, Chirp, Grid, simulate_points
from waveformer.simulator.focusing import focus
scan = simulate_points([[0.0, 0.0, -0.34]], [1e-3], Chirp(77.5e9, 3e9, 16), Aperture.planar_grid(12, 12, 0.01))
np.save(sys.argv[1], focus(scan, Grid.box((-0.02, -0.02, -0.35), (0.02, 0.02, -0.32), 0.004)).image)
"""
    images = []
    for threads in ("1", "2"):
        path = tmp_path / f"{threads}.npy"
        subprocess.run(
            [sys.executable, "-c", program, str(path)],
            check=True,
            env={**os.environ, "WAVEFORMER_THREADS": threads},
        )
        images.append(np.load(path))
    # every voxel is summed by one lane in one order
    assert np.array_equal(*images)
