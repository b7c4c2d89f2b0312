import numpy as np
import pytest

from waveformer.model import reference_potential as slow
from waveformer.model.components import connected_components
from waveformer.model.potential import integrate_breadth_first, integrate_least_squares
from waveformer.model.voxels import voxel_positions_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

CUBES = (0.003, 0.003, 0.003)
BOXES = (0.002, 0.003, 0.005)


def regular(shape, edges_m):
    return Grid(*(0.1 + np.arange(count) * edge for count, edge in zip(shape, edges_m, strict=True)))


def random_case(rng, edges_m, shape=(12, 10, 9), density=0.55):
    grid = regular(shape, edges_m)
    component = connected_components(rng.random(shape) < density, grid, minimum_volume_m3=0.0)[0]
    normals = rng.normal(size=(*shape, 3)).astype(np.float32)
    outside = np.ones(shape, dtype=bool)
    outside[tuple(component.T)] = False
    normals[outside] = np.nan
    return grid, component, normals


@pytest.mark.parametrize("edges_m", [CUBES, BOXES])
@pytest.mark.parametrize("density", [0.4, 0.55, 0.9, 1.0])
def test_generations_equal_the_queue_exactly(rng, edges_m, density):
    for _ in range(4):
        grid, component, normals = random_case(rng, edges_m, (9, 8, 7), density)
        fast = integrate_breadth_first(normals, component, grid)
        np.testing.assert_array_equal(fast, slow.integrate_breadth_first(normals, component, grid))


@pytest.mark.parametrize("edges_m", [CUBES, BOXES])
def test_a_constant_field_integrates_to_a_plane(rng, edges_m):
    grid, component, normals = random_case(rng, edges_m)
    direction = np.array([0.2, -0.4, 0.9])
    normals[:] = 5 * direction
    height = voxel_positions_m(grid, component) @ direction / np.linalg.norm(direction)
    for potential in (
        integrate_breadth_first(normals, component, grid),
        integrate_least_squares(normals, np.ones(grid.shape), component, grid),
    ):
        constant = height[np.argmin(np.abs(potential))]
        # Conjugate gradients stop at a relative residual of 1e-8; f spans 40 mm.
        np.testing.assert_allclose(potential, height - constant, atol=1e-8)
        assert np.corrcoef(potential, height)[0, 1] > 0.999


@pytest.mark.parametrize("edges_m", [CUBES, BOXES])
def test_least_squares_equals_the_dense_solve(rng, edges_m):
    grid, component, normals = random_case(rng, edges_m, shape=(7, 6, 6))
    weights = rng.uniform(0.1, 2.0, grid.shape)
    fast = integrate_least_squares(normals, weights, component, grid)
    dense = slow.integrate_least_squares(normals, weights, component, grid)
    # Residual tolerance 1e-8 of a field of about 10 mm, times a condition number of about 100.
    np.testing.assert_allclose(fast, dense, atol=1e-8)


def test_weights_decide_where_normals_contradict_each_other():
    """A closed loop of four voxels cannot meet four equal rises; the weak link gives way."""
    grid = regular((2, 2, 2), CUBES)
    loop = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]])
    normals = np.full((2, 2, 2, 3), 1.0)
    normals[0, 0, 0] = normals[0, 1, 0] = [0, 1, 0]
    normals[1, 0, 0] = normals[1, 1, 0] = [0, -1, 0]
    weights = np.ones((2, 2, 2))
    weights[1] = 1e-6
    potential = integrate_least_squares(normals, weights, loop, grid)
    assert potential[1] - potential[0] == pytest.approx(0.003, rel=1e-5)


def test_the_zero_is_at_the_voxel_nearest_the_centroid():
    grid = regular((5, 5, 5), CUBES)
    component = np.argwhere(np.ones((5, 5, 5), dtype=bool))
    normals = np.broadcast_to([0.0, 0.0, 1.0], (5, 5, 5, 3))
    potential = integrate_breadth_first(normals, component, grid)
    assert potential[(component == 2).all(axis=1)] == 0.0


def test_the_arrival_normal_counts():
    grid = regular((3, 1, 1), CUBES)
    normals = np.zeros((3, 1, 1, 3))
    normals[:, 0, 0] = [[1.0, 0, 0], [0, 0, 1], [-0.6, 0, 0.8]]
    potential = integrate_breadth_first(normals, np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), grid)
    np.testing.assert_allclose(potential, [-0.003, 0, -0.6 * 0.003], rtol=1e-12)


def test_a_single_voxel_is_zero():
    grid = regular((3, 3, 3), CUBES)
    one = np.array([[1, 2, 0]])
    assert integrate_breadth_first(np.ones((3, 3, 3, 3)), one, grid) == [0.0]
    assert integrate_least_squares(np.ones((3, 3, 3, 3)), np.ones((3, 3, 3)), one, grid) == [0.0]


def test_refuses_what_cannot_be_integrated():
    grid = regular((3, 3, 3), CUBES)
    normals, weights = np.ones((3, 3, 3, 3)), np.ones((3, 3, 3))
    apart = np.array([[0, 0, 0], [2, 2, 2]])
    both = np.array([[0, 0, 0], [0, 0, 1]])
    for call in (
        lambda: integrate_breadth_first(normals, apart, grid),
        lambda: integrate_least_squares(normals, weights, apart, grid),
    ):
        with pytest.raises(RadarError, match="not 6-connected"):
            call()
    with pytest.raises(RadarError, match="do not fit"):
        integrate_least_squares(normals, weights[:2], both, grid)
    with pytest.raises(RadarError, match="positive"):
        integrate_least_squares(normals, 0 * weights, both, grid)
    with pytest.raises(RadarError, match="not evenly spaced"):
        integrate_breadth_first(normals, both, Grid([0.0, 1, 3], [0.0, 1, 2], [0.0, 1, 2]))
