"""An image comes back as it was saved, on the same grid."""

import numpy as np
import pytest

from waveformer.simulator.errors import RadarError, StoreError
from waveformer.simulator.grid import Grid
from waveformer.simulator.image import Image
from waveformer.simulator.measurement import Measurement

GRID = Grid(np.linspace(0, 1, 70), np.array([0.0, 0.1, 0.3]), np.array([-0.4]))


def make() -> Image:
    rng = np.random.default_rng(0)
    values = rng.normal(size=GRID.shape) + 1j * rng.normal(size=GRID.shape)
    return Image(values.astype(np.complex64), GRID, {"spacing_m": 0.003})


def test_round_trip_is_exact(tmp_path):
    saved = make()
    saved.save(tmp_path / "image.zarr")
    loaded = Image.load(tmp_path / "image.zarr")
    assert loaded.values.tobytes() == saved.values.tobytes()
    assert loaded.metadata == saved.metadata
    for name in ("x", "y", "z"):
        np.testing.assert_array_equal(getattr(loaded.grid, name), getattr(GRID, name))


def test_lost_chunk_is_refused(tmp_path):
    make().save(tmp_path / "image.zarr")
    (tmp_path / "image.zarr" / "values/c/1/0/0").unlink()
    with pytest.raises(StoreError, match="values differs from what was written"):
        Image.load(tmp_path / "image.zarr")


def test_scan_is_not_an_image(tmp_path):
    make().save(tmp_path / "image.zarr")
    with pytest.raises(StoreError, match=r"holds a waveformer\.image, not a waveformer\.measurement"):
        Measurement.load(tmp_path / "image.zarr")


def test_shape_must_match_the_grid():
    with pytest.raises(RadarError, match=r"grid's shape \(70, 3, 1\), got \(3, 70, 1\)"):
        Image(np.zeros((3, 70, 1), np.complex64), GRID)
    with pytest.raises(RadarError, match="must be complex"):
        Image(np.zeros(GRID.shape), GRID)


def test_peak_position():
    values = np.zeros(GRID.shape, np.complex64)
    values[7, 2, 0] = -3j
    np.testing.assert_array_equal(Image(values, GRID).peak_position_m, [GRID.x[7], 0.3, -0.4])
