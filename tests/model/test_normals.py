import numpy as np
import pytest

from waveformer.model.normals import angular_error_deg, component_normals, gradient_normals, has_normal
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid


def test_angles():
    first = np.array([[1.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 0, 1e-9], [0, 0, 3]])
    second = np.array([[2.0, 0, 0], [0, 5, 0], [-1, 0, 0], [0, 1, 1], [1e-8, 0, 1]])
    # The arc cosine would round the last one, 1e-8 rad, to zero.
    np.testing.assert_allclose(
        angular_error_deg(first, second), [0, 90, 180, 45, np.degrees(1e-8)], rtol=1e-12
    )


def test_normals_of_a_component_are_of_unit_length(rng):
    normals = rng.normal(size=(3, 4, 5, 3)).astype(np.float32)
    normals[0, 0, 0] = np.nan
    component = np.array([[1, 2, 3], [2, 3, 4]])
    found = component_normals(normals, component)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-15)
    assert angular_error_deg(found, normals[[1, 2], [2, 3], [3, 4]]).max() < 1e-5
    assert has_normal(normals).sum() == 59


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.0])
def test_refuses_voxels_without_normal(bad):
    normals = np.ones((2, 2, 2, 3))
    normals[1, 1, 1] = bad
    assert has_normal(normals).sum() == 7
    with pytest.raises(RadarError, match="1 of 2 voxels have no normal"):
        component_normals(normals, np.array([[0, 0, 0], [1, 1, 1]]))


@pytest.mark.parametrize(
    "component",
    [np.empty((0, 3), dtype=int), np.array([[0, 0, 2]]), np.array([[-1, 0, 0]]), np.array([0, 0, 0])],
)
def test_refuses_components_outside(component):
    with pytest.raises(RadarError):
        component_normals(np.ones((2, 2, 2, 3)), component)


def test_gradient_of_a_plane_on_voxels_that_are_not_cubes(rng):
    grid = Grid(np.arange(6) * 0.002, np.arange(5) * 0.003, np.arange(7) * 0.005)
    component = np.argwhere(rng.random(grid.shape) < 0.7)
    table_rich = component[[(np.abs(component - voxel).sum(axis=1) == 1).sum() >= 5 for voxel in component]]
    direction = np.array([0.3, -0.5, 0.8])
    position = np.stack(
        [axis[column] for axis, column in zip((grid.x, grid.y, grid.z), component.T, strict=True)], 1
    )
    found = gradient_normals(position @ direction, component, grid)
    rich = [component.tolist().index(voxel) for voxel in table_rich.tolist()]
    assert len(rich) > 5
    assert angular_error_deg(found[rich], direction).max() < 1e-5


def test_a_voxel_without_gradient_points_up():
    grid = Grid(np.arange(2.0), np.arange(2.0), np.arange(2.0))
    np.testing.assert_array_equal(gradient_normals(np.zeros(1), np.array([[1, 1, 1]]), grid), [[0, 0, 1]])
