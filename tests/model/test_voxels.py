import numpy as np
import pytest

from waveformer.model.voxels import cubic_edge_m, voxel_edges_m, voxel_positions_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid


def test_edges_and_positions():
    grid = Grid([0.0, 0.002, 0.004], [1.0, 1.003], [-0.5, -0.496, -0.492, -0.488])
    np.testing.assert_allclose(voxel_edges_m(grid), [0.002, 0.003, 0.004], rtol=1e-12)
    np.testing.assert_array_equal(
        voxel_positions_m(grid, np.array([[2, 0, 3], [0, 1, 0]])), [[0.004, 1.0, -0.488], [0.0, 1.003, -0.5]]
    )


def test_an_axis_of_one_voxel_takes_the_shortest_edge():
    np.testing.assert_allclose(voxel_edges_m(Grid([0.0], [0.0, 0.003], [0.0, 0.002])), [0.002, 0.003, 0.002])


def test_repeated_addition_is_still_regular():
    z = np.cumsum(np.full(250, 0.001))
    assert cubic_edge_m(Grid(z, z, z)) == pytest.approx(0.001)


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        (Grid([0.0, 0.001, 0.003], [0.0, 0.001], [0.0, 0.001]), "axis x is not evenly spaced"),
        (Grid([0.0], [0.0], [0.0]), "single voxel has no spacing"),
    ],
)
def test_refuses_irregular_grids(grid, message):
    with pytest.raises(RadarError, match=message):
        voxel_edges_m(grid)


def test_refuses_voxels_that_are_not_cubes():
    with pytest.raises(RadarError, match="2 x 2 x 3 mm are not cubes"):
        cubic_edge_m(Grid([0.0, 0.002], [0.0, 0.002], [0.0, 0.003]))
