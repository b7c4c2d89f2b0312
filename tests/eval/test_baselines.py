"""Baselines: thresholds, and completions of shapes whose completion is known."""

import numpy as np
import pytest
import trimesh

from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.eval.baselines import (
    backprojection_cloud,
    extrude_to_support,
    mirror,
)
from waveformer.eval.metrics import score_reconstruction
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.grid import Grid

GRID = Grid.box((0, 0, -0.1), (0.03, 0.02, -0.08), 0.01)
SUPPORT_M = -0.45


def plate(height_m=-0.40, pitch_m=0.003, sides_m=(0.099, 0.06)):
    """A horizontal rectangle at the centres of voxels."""
    x, y = (np.arange(pitch_m / 2, side, pitch_m) for side in sides_m)
    x, y = np.meshgrid(x, y, indexing="ij")
    return np.stack([x, y, np.full(x.shape, height_m)], axis=-1).reshape(-1, 3)


def test_voxels_above_a_share():
    image = np.zeros(GRID.shape, np.complex64)
    image[1, 2, 0], image[3, 0, 2], image[0, 0, 0] = 10j, -4.01, 4.0
    np.testing.assert_allclose(backprojection_cloud(image, GRID), [(0.01, 0.02, -0.1), (0.03, 0, -0.08)])
    assert len(backprojection_cloud(image, GRID, 0.3)) == 3
    assert len(backprojection_cloud(image, GRID, 0.5)) == 1


def test_a_dark_image_has_no_cloud():
    dark = np.zeros(GRID.shape, np.complex64)
    assert backprojection_cloud(dark, GRID).shape == (0, 3)


def test_bad_images_are_refused():
    with pytest.raises(RadarError, match="does not fit"):
        backprojection_cloud(np.ones((2, 2, 2), np.complex64), GRID)
    with pytest.raises(RadarError, match="36 non-finite"):
        backprojection_cloud(np.full(GRID.shape, np.nan, np.complex64), GRID)
    with pytest.raises(RadarError, match="share"):
        backprojection_cloud(np.ones(GRID.shape, np.complex64), GRID, 1.0)


def test_a_plate_becomes_a_box(rng):
    completion = extrude_to_support(plate(), SUPPORT_M, 8000, rng)
    assert completion.points_m.shape == (8000, 3)
    hidden = completion.hidden_m
    low, high = np.array([0, 0, -0.45]), np.array([0.099, 0.06, -0.40])
    # Columns start one point early, so the walls stand half a point spacing beside the true ones.
    low[:2] -= 0.0016
    high[:2] += 0.0016
    assert (hidden >= low).all() and (hidden <= high).all()
    on_floor = hidden[:, 2] == SUPPORT_M
    edges = np.abs(hidden[:, None, :2] - [(0, 0), (0.099, 0.06)]).min(axis=(1, 2))
    assert (on_floor | (edges < 0.0017)).all()
    # Areas: floor and plate 99 x 60, walls 2 (99 + 60) x 50; five standard deviations of the drawn share.
    floor, walls = 99 * 60, 2 * (99 + 60) * 50
    assert len(hidden) == pytest.approx(8000 * (floor + walls) / (2 * floor + walls), abs=1)
    assert on_floor.mean() == pytest.approx(floor / (floor + walls), abs=0.03)
    box = trimesh.creation.box(bounds=[(0, 0, -0.45), (0.099, 0.06, -0.40)])
    truth = TruthCloud(trimesh.sample.sample_surface(box, 4000, seed=1)[0])
    score = score_reconstruction(completion.points_m, truth)
    assert (score.precision, score.recall) == (1, 1)


def test_walls_end_at_the_lowest_point_of_their_column(rng):
    slope = plate()
    slope[:, 2] = -0.44 + 0.4 * slope[:, 0]
    hidden = extrude_to_support(slope, SUPPORT_M, 5000, rng).hidden_m
    assert (hidden[:, 2] <= -0.44 + 0.4 * (hidden[:, 0] + 0.0031)).all()


def test_a_gap_is_closed_and_a_hole_walled(rng):
    cloud = plate()
    gap = (np.abs(cloud[:, :2] - [0.0495, 0.0315]) < 0.001).all(axis=1)
    hole = (np.abs(cloud[:, :2] - [0.03, 0.03]) < 0.01).all(axis=1)
    assert gap.sum() == 1
    hidden = extrude_to_support(cloud[~gap & ~hole], SUPPORT_M, 20_000, rng).hidden_m
    upright = hidden[hidden[:, 2] > SUPPORT_M]
    assert not (np.abs(upright[:, :2] - [0.0495, 0.0315]) < 0.004).all(axis=1).any()
    assert (np.abs(upright[:, :2] - [0.03, 0.03]) < 0.013).all(axis=1).any()
    on_floor = hidden[hidden[:, 2] == SUPPORT_M]
    assert not (np.abs(on_floor[:, :2] - [0.03, 0.03]) < 0.006).all(axis=1).any()


def test_mirror_puts_the_top_on_the_support(rng):
    roof = plate()
    roof[:, 2] += 0.2 * np.minimum(roof[:, 0], 0.05)
    completion = mirror(roof, SUPPORT_M, 3001, rng)
    assert (len(completion.partial_m), len(completion.hidden_m)) == (1501, 1500)
    assert completion.hidden_m[:, 2].min() == pytest.approx(SUPPORT_M)
    middle_m = (roof[:, 2].max() + SUPPORT_M) / 2
    back = completion.hidden_m * [1, 1, -1] + [0, 0, 2 * middle_m]
    offset_m = np.linalg.norm(back[:, None] - roof[None], axis=2).min(axis=1)
    assert offset_m.max() < 1e-12


@pytest.mark.parametrize("complete", [extrude_to_support, mirror])
class TestBoth:
    def test_keeps_the_partial(self, complete, rng):
        completion = complete(plate(), SUPPORT_M, 4000, rng)
        known = {tuple(point) for point in plate()}
        assert {tuple(point) for point in completion.partial_m} <= known
        # 660 points where more than 660 are due: all occur, equally often.
        times = np.unique(completion.partial_m, axis=0, return_counts=True)[1]
        assert times.max() - times.min() <= 1
        assert len(times) == 660

    def test_the_seed_decides(self, complete):
        first, again, other = (
            complete(plate(), SUPPORT_M, 500, np.random.default_rng(seed)).points_m for seed in (0, 0, 1)
        )
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)

    def test_nothing_and_nothing_above_the_support(self, complete, rng):
        assert complete([], SUPPORT_M, 100, rng).points_m.shape == (0, 3)
        sunken = complete(plate(-0.5), SUPPORT_M, 100, rng)
        assert (len(sunken.partial_m), len(sunken.hidden_m)) == (100, 0)

    def test_partly_below_the_support(self, complete, rng):
        tilted = plate()
        tilted[:, 2] = -0.46 + 0.5 * tilted[:, 0]
        assert len(complete(tilted, SUPPORT_M, 1000, rng).points_m) == 1000

    def test_a_single_point(self, complete, rng):
        assert len(complete([(0.0, 0.0, -0.4)], SUPPORT_M, 100, rng).points_m) == 100

    def test_bad_input_is_refused(self, complete, rng):
        with pytest.raises(MeshError, match="not finite"):
            complete([(0, np.nan, 0)], SUPPORT_M, 10, rng)
        with pytest.raises(RadarError, match="support_z_m"):
            complete(plate(), np.nan, 10, rng)
