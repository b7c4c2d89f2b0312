"""Pictures show what is in the data, at the right place."""

import matplotlib.image
import numpy as np
import pytest
import trimesh

from waveformer.eval.figures import image_figure, range_profile_figure
from waveformer.simulator.grid import Grid
from waveformer.simulator.image import Image
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

GRID = Grid.box((-0.1, -0.05, -0.45), (0.1, 0.05, -0.35), 0.005)  # 41 x 21 x 21
PEAK = (30, 5, 15)


def one_voxel() -> Image:
    values = np.zeros(GRID.shape, np.complex64)
    values[PEAK] = 2j
    return Image(values, GRID)


def panels(picture: np.ndarray) -> list[np.ndarray]:
    """The three dark rectangles of an image figure, as RGB arrays."""
    dark = (picture < 0.05).all(axis=-1)
    columns = np.flatnonzero(dark.mean(axis=0) > 0.2)
    cut = [run for run in np.split(columns, np.flatnonzero(np.diff(columns) > 5) + 1) if len(run) > 50]
    found = []
    for run in cut:
        rows = np.flatnonzero(dark[:, run[0] : run[-1]].mean(axis=1) > 0.5)
        found.append(picture[rows[0] : rows[-1] + 1, run[0] : run[-1] + 1])
    return found


def test_peak_is_drawn_where_it_is(tmp_path):
    image_figure(one_voxel(), tmp_path / "image.png")
    picture = matplotlib.image.imread(tmp_path / "image.png")[..., :3]
    drawn = panels(picture)
    assert len(drawn) == 3
    for panel, (across, up) in zip(drawn, [(0, 1), (0, 2), (1, 2)], strict=True):
        top_color = (panel[..., 0] > 0.9) & (panel[..., 1] > 0.9) & (panel[..., 2] < 0.8)
        rows, columns = np.nonzero(top_color)
        height, width = panel.shape[:2]
        # A voxel is at least 5 pixels wide in this figure; half of one is allowed.
        assert columns.mean() / width == pytest.approx((PEAK[across] + 0.5) / GRID.shape[across], abs=0.02)
        assert 1 - rows.mean() / height == pytest.approx((PEAK[up] + 0.5) / GRID.shape[up], abs=0.02)


def test_mesh_outline_and_aperture_are_drawn(tmp_path):
    mesh = load_mesh(trimesh.creation.icosphere(radius=0.03).apply_translation((0, 0, -0.4)))
    aperture = Aperture.planar_grid(5, 5, 0.01)
    image_figure(one_voxel(), tmp_path / "image.png", meshes=[mesh], aperture=aperture)
    for panel in panels(matplotlib.image.imread(tmp_path / "image.png")[..., :3]):
        blue = (panel[..., 2] > 0.6) & (panel[..., 2] > panel[..., 0] + 0.2)
        rows, columns = np.nonzero(blue)
        pixel_m = 0.105 / panel.shape[0]
        # A circle of 6 cm in every view; the outline lies up to two raster pixels (0.4 mm) outside.
        assert np.ptp(rows) * pixel_m == pytest.approx(0.06, abs=0.0015)
        assert np.ptp(columns) * pixel_m == pytest.approx(0.06, abs=0.0015)


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 5, 4), (300, 2, 2)])
def test_empty_and_thin_images_are_drawn(tmp_path, shape):
    grid = Grid(*(np.arange(n) * 0.003 for n in shape))
    image_figure(Image(np.zeros(shape, np.complex64), grid), tmp_path / "image.png")
    assert (tmp_path / "image.png").stat().st_size > 1000


@pytest.mark.parametrize("amplitude", [1e-4, 0.0])
def test_range_profile_figure(tmp_path, amplitude):
    chirp = Chirp(77e9, 4e9, 32)
    aperture = Aperture.planar_grid(40, 40, 0.005)
    range_m = np.linalg.norm(aperture.tx_m - [0, 0, -0.4], axis=1)
    delay_s = 2 * range_m[:, None] / SPEED_OF_LIGHT_M_PER_S
    h = amplitude * np.exp(-2j * np.pi * chirp.frequencies_hz * delay_s)
    range_profile_figure(Measurement(h, chirp, aperture), tmp_path / "profile.png")
    picture = matplotlib.image.imread(tmp_path / "profile.png")[..., :3]
    assert picture.std() > 0.1


def test_a_box_is_drawn_around_the_image(tmp_path):
    box_m = np.array([[-0.15, -0.075, -0.5], [0.15, 0.075, -0.3]])
    image_figure(one_voxel(), tmp_path / "image.png", box_m=box_m)
    picture = matplotlib.image.imread(tmp_path / "image.png")[..., :3]
    brown = np.ptp(picture, axis=-1) > 0.1  # all else is grey, but for one voxel and the colour bar
    rows = np.flatnonzero(brown.sum(axis=1) > 0.25 * picture.shape[1])
    top = np.flatnonzero(brown[rows[0]])
    front = np.split(top, np.flatnonzero(np.diff(top) > 5) + 1)[0]
    # 30 cm wide and 20 cm high from the front, to a pixel of 250; views that ended with the image would show no box
    assert np.ptp(front) / np.ptp(rows) == pytest.approx(30 / 20, rel=0.01)
