"""Backprojection against Eq. 1 term by term, and against the operator it is the adjoint of."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator import imaging
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid
from waveformer.simulator.imaging import backproject, grid_blocks, project
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.points import simulate_points
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference import dense_backproject, dense_project

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 4e9, 32)
PLANE = Aperture.planar_grid(10, 9, 0.006)
PAIRS = Aperture(PLANE.tx_m, PLANE.tx_m + [0.02, -0.01, 0.0])
IRREGULAR = Aperture(PLANE.tx_m, PLANE.tx_m + np.random.default_rng(3).uniform(-0.02, 0.02, PLANE.tx_m.shape))
APERTURES = pytest.mark.parametrize(
    "aperture", [PLANE, PAIRS, IRREGULAR], ids=["monostatic", "pairs", "irregular"]
)
GRID = Grid.box([-0.015, -0.02, -0.32], [0.02, 0.02, -0.29], 0.005)
POINT = np.array([0.005, -0.01, -0.305])


def noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


def imaged(h: np.ndarray, aperture: Aperture, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """The image, and the dense one."""
    image = backproject(Measurement(h, CHIRP, aperture), grid)
    assert image.dtype == np.complex64
    assert image.shape == grid.shape
    return image, dense_backproject(h.astype(complex), CHIRP, aperture, grid)


@APERTURES
def test_the_image_of_an_echo_is_eq_1_term_by_term(aperture: Aperture) -> None:
    h = simulate_points(POINT[None], 1.0, CHIRP, aperture).h
    image, expected = imaged(h, aperture, GRID)
    assert (
        difference(image, expected) < 1e-3
    )  # imaging.TOLERANCE of the largest voxel, where all terms add up


@APERTURES
def test_the_image_of_noise_is_eq_1_term_by_term(rng: np.random.Generator, aperture: Aperture) -> None:
    image, expected = imaged(noise(rng, len(aperture), CHIRP.num_samples), aperture, GRID)
    # a tolerance of 1e-3 a term, and terms of random phase in the errors as in the sum
    assert difference(image, expected) < 1e-3


@APERTURES
def test_projection_equals_the_dense_sum(rng: np.random.Generator, aperture: Aperture) -> None:
    image = noise(rng, *GRID.shape)
    h = project(image, GRID, CHIRP, aperture)
    assert h.shape == (len(aperture), CHIRP.num_samples)
    # a tolerance of 1e-3 a term, and terms of random phase in the errors as in the sum
    assert difference(h, dense_project(image, GRID, CHIRP, aperture)) < 1e-3


@APERTURES
def test_backprojection_is_the_adjoint_of_projection(rng: np.random.Generator, aperture: Aperture) -> None:
    image = noise(rng, *GRID.shape)
    projected = project(image, GRID, CHIRP, aperture).astype(complex)
    h = projected.astype(np.complex64) + noise(rng, *projected.shape) * np.abs(projected).mean()
    back = backproject(Measurement(h, CHIRP, aperture), GRID).astype(complex)
    forward = np.vdot(h.astype(complex), projected)
    assert abs(forward - np.vdot(back, image.astype(complex))) < 1e-5 * abs(forward)  # float32


def test_shifting_moments_back_is_the_transpose_of_shifting_them(rng: np.random.Generator) -> None:
    from waveformer.simulator.kernel_factorised import _shifted
    from waveformer.simulator.kernel_points import _shifted_adjoint

    # too small a part of an image to show there, so the two matrices are compared entry by entry
    for offset in rng.uniform(-1, 1, 5):
        forward = np.array([_shifted(list(unit), offset) for unit in np.eye(4)]).T
        adjoint = np.array([_shifted_adjoint(list(unit), offset) for unit in np.eye(4)]).T
        assert adjoint == pytest.approx(forward.T, abs=1e-15)
        shifted = np.array([(0.3 + offset) ** i for i in range(4)])
        assert forward @ 0.3 ** np.arange(4) == pytest.approx(shifted)


def test_a_point_focuses_at_its_place_with_all_terms_in_phase() -> None:
    grid = Grid.box(POINT - [0.02, 0.02, 0.02], POINT + [0.02, 0.02, 0.02], 0.0025)
    h = simulate_points(POINT[None], 1.0, CHIRP, PLANE).h
    image = backproject(Measurement(h, CHIRP, PLANE), grid)
    i, j, k = np.unravel_index(np.abs(image).argmax(), grid.shape)
    assert [grid.x[i], grid.y[j], grid.z[k]] == pytest.approx(POINT)
    assert image[i, j, k] == pytest.approx(np.abs(h).sum(), rel=1e-3)  # imaging.TOLERANCE


def test_value_i_j_k_belongs_to_x_i_y_j_z_k() -> None:
    grid = Grid(np.array([0.0, 0.01]), np.array([-0.01, 0.0, 0.005]), np.array([-0.33, -0.305, -0.3, -0.29]))
    point = [grid.x[1], grid.y[2], grid.z[1]]
    image = backproject(simulate_points([point], 1.0, CHIRP, PLANE), grid)
    assert np.unravel_index(np.abs(image).argmax(), grid.shape) == (1, 2, 1)


def test_the_known_range_bias_is_taken_out() -> None:
    bias_m = 0.03  # of the round trip
    grid = Grid(POINT[:1], POINT[1:2], np.arange(POINT[2] - 0.03, POINT[2] + 0.03, 0.0025))
    clean = simulate_points(POINT[None], 1.0, CHIRP, PLANE)
    biased = clean.h * np.exp(-2j * np.pi * CHIRP.frequencies_hz * bias_m / SPEED_OF_LIGHT_M_PER_S)
    expected = backproject(clean, grid)
    told = backproject(Measurement(biased, CHIRP, PLANE, range_bias_m=bias_m), grid)
    untold = backproject(Measurement(biased, CHIRP, PLANE), grid)
    assert difference(told, expected) < 1e-6  # float32
    peak_m = grid.z[np.abs(untold).argmax()]
    # half of the round trip, further away; the slanted ways of this aperture blur it by less than 3 mm
    assert peak_m - POINT[2] == pytest.approx(-bias_m / 2, abs=3e-3)


def test_the_image_of_a_grid_equals_those_of_its_halves(rng: np.random.Generator) -> None:
    grid = Grid.box([-0.03, -0.02, -0.32], [0.03, 0.02, -0.29], 0.004)
    h = Measurement(noise(rng, len(PLANE), CHIRP.num_samples), CHIRP, PLANE)
    whole = backproject(h, grid)
    halves = [backproject(h, Grid(grid.x[part], grid.y, grid.z)) for part in (slice(0, 7), slice(7, None))]
    assert difference(np.concatenate(halves), whole) < 1e-3  # other cells: imaging.TOLERANCE


def test_many_blocks_give_the_image_of_one(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    h = Measurement(noise(rng, len(PLANE), CHIRP.num_samples), CHIRP, PLANE)
    image = noise(rng, *GRID.shape)
    one = backproject(h, GRID), project(image, GRID, CHIRP, PLANE)
    monkeypatch.setattr(imaging, "_CELLS_PER_BLOCK_EDGE", 2)
    blocks = list(grid_blocks(GRID, CHIRP, PLANE))
    assert len(blocks) > 8
    assert sum(np.prod(block.shape) for block in blocks) == np.prod(GRID.shape)
    many = backproject(h, GRID), project(image, GRID, CHIRP, PLANE)
    for part, whole in zip(many, one, strict=True):
        assert difference(part, whole) < 1e-3  # other tiles and bins: imaging.TOLERANCE


def test_a_grid_around_the_antennas_is_imaged_right(rng: np.random.Generator) -> None:
    aperture = Aperture(PLANE.tx_m[[0, 44, 45, 89]])
    grid = Grid.box([-0.03, -0.027, -0.012], [0.03, 0.0271, 0.012], 0.006)
    voxels = np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1).reshape(-1, 3)
    distance = np.linalg.norm(voxels[:, None] - aperture.tx_m, axis=2).min()
    assert 0 < distance < 0.005
    image, expected = imaged(noise(rng, 4, CHIRP.num_samples), aperture, grid)
    assert difference(image, expected) < 1e-3  # every row is its own node: imaging.TOLERANCE of the moments


def test_a_voxel_on_an_antenna_is_imaged_right(rng: np.random.Generator) -> None:
    aperture = Aperture([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    grid = Grid.box([-0.01, -0.01, -0.01], [0.013, 0.01, 0.01], 0.005)
    image, expected = imaged(noise(rng, 2, CHIRP.num_samples), aperture, grid)
    assert difference(image, expected) < 1e-3  # every row is its own node: imaging.TOLERANCE of the moments


def test_a_cell_centered_on_an_antenna_is_imaged_right(rng: np.random.Generator) -> None:
    aperture = Aperture([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    image, expected = imaged(noise(rng, 2, CHIRP.num_samples), aperture, Grid(*np.zeros((3, 1))))
    assert difference(image, expected) < 1e-3  # imaging.TOLERANCE


@pytest.mark.parametrize("at_m", [(0.0, 0.0, -0.3), (0.05, -0.2, -0.6), (0.0, 0.0, 0.4)])
def test_a_single_voxel_is_the_whole_sum(rng: np.random.Generator, at_m: tuple[float, ...]) -> None:
    grid = Grid(*(np.array([value]) for value in at_m))
    h = noise(rng, len(PLANE), CHIRP.num_samples)
    image, expected = imaged(h, PLANE, grid)
    # bins 1e-3 of a term, and terms of random phase: relative to the root of the sum of squares
    assert abs(image - expected).item() < 1e-3 * np.linalg.norm(h)


def test_pitches_may_differ_and_vary(rng: np.random.Generator) -> None:
    grid = Grid(
        np.linspace(-0.02, 0.02, 5),
        np.linspace(-0.1, 0.1, 4),
        -0.3 - np.array([0.08, 0.03, 0.011, 0.01, 0.0]),
    )
    image, expected = imaged(noise(rng, len(PLANE), CHIRP.num_samples), PLANE, grid)
    assert difference(image, expected) < 1e-3  # imaging.TOLERANCE, errors of random phase


def test_no_voxel_is_lost_when_cells_are_cut() -> None:
    grid = Grid.box([-0.05, -0.03, -0.4], [0.05, 0.03, -0.3], 0.0035)
    seen = np.zeros(grid.shape, dtype=int)
    for block in grid_blocks(grid, CHIRP, PLANE):
        seen[block.slices] += 1
        assert sorted(block.order) == list(range(len(block.order)))
        assert (np.diff(block.cell) >= 0).all()
        assert (block.cell == np.repeat(np.arange(len(block.centers_m)), np.diff(block.starts))).all()
        axes = [axis[part] for axis, part in zip((grid.x, grid.y, grid.z), block.slices, strict=True)]
        voxels = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)[block.order]
        assert block.centers_m[block.cell] + block.offsets_m == pytest.approx(voxels, abs=1e-12)
    assert (seen == 1).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, complex(0, -np.inf)])
def test_a_recording_with_holes_is_refused(bad: Any) -> None:
    h = np.ones((len(PLANE), CHIRP.num_samples), dtype=np.complex64)
    h[3, 4] = bad
    with pytest.raises(RadarError, match="non-finite samples"):
        backproject(Measurement(h, CHIRP, PLANE), GRID)


def test_an_image_of_another_shape_is_not_projected() -> None:
    with pytest.raises(RadarError, match="does not fit the grid"):
        project(np.zeros((1, 2, 3), np.complex64), GRID, CHIRP, PLANE)


def test_progress_ends_at_the_number_of_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(imaging, "_CELLS_PER_BLOCK_EDGE", 2)
    calls: list[tuple[int, int]] = []
    measurement = simulate_points(POINT[None], 1.0, CHIRP, PLANE)
    backproject(measurement, GRID, progress=lambda done, total: calls.append((done, total)))
    count = int(np.prod(GRID.shape))
    assert calls[-1] == (count, count)
    assert [done for done, _ in calls] == sorted({done for done, _ in calls})
