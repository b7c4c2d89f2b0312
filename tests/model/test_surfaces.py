import numpy as np
import pytest

from waveformer.model.surfaces import (
    PotentialField,
    all_surface_points,
    levels,
    sample_points,
    surface_points,
    voxel_points,
)
from waveformer.model.voxels import voxel_positions_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid

WAVELENGTH_M = 0.00386828
BOXES = (0.002, 0.003, 0.0025)


def regular(shape, edges_m=(0.003, 0.003, 0.003)):
    return Grid(*(-0.02 + np.arange(count) * edge for count, edge in zip(shape, edges_m, strict=True)))


def plane_field(direction, edges_m=BOXES, shape=(12, 10, 14)):
    grid = regular(shape, edges_m)
    index = np.argwhere(np.ones(shape, dtype=bool))
    return PotentialField(grid, index, voxel_positions_m(grid, index) @ np.asarray(direction))


def sphere_field(edge_m=0.003, radius_m=0.04):
    """The signed distance of a sphere around the origin, in a cap of voxels near its top."""
    grid = Grid.box([-0.045, -0.045, 0.0], [0.045, 0.045, 0.06], edge_m)
    index = np.argwhere(np.ones(grid.shape, dtype=bool))
    position = voxel_positions_m(grid, index)
    distance = np.linalg.norm(position, axis=1) - radius_m
    cap = (np.abs(distance) < 0.012) & (position[:, 2] > 0.6 * np.linalg.norm(position, axis=1))
    return PotentialField(grid, index[cap], distance[cap])


def slow_crossings(field, level_m):
    """Column by column from the top: where f first rises through the level between two neighbours."""
    found = {}
    value = dict(zip(map(tuple, field.index.tolist()), field.potential_m, strict=True))
    for i in range(len(field.grid.x)):
        for j in range(len(field.grid.y)):
            for k in reversed(range(len(field.grid.z) - 1)):
                below, above = value.get((i, j, k)), value.get((i, j, k + 1))
                if below is None or above is None or not below <= level_m < above:
                    continue
                share = (level_m - below) / (above - below)
                found[i, j] = (1 - share) * field.grid.z[k] + share * field.grid.z[k + 1]
                break
    return found


def test_crossings_equal_the_slow_search_on_a_rough_field_with_gaps(rng):
    grid = regular((9, 8, 12))
    index = np.argwhere(rng.random(grid.shape) < 0.8)
    rough = voxel_positions_m(grid, index)[:, 2] + rng.normal(scale=0.004, size=len(index))
    field = PotentialField(grid, index, rough)
    chosen = levels(field, WAVELENGTH_M)
    stack = all_surface_points(field, chosen)
    assert (np.diff(stack.level) >= 0).all()
    for position, level_m in enumerate(chosen):
        middle = stack.points_m[stack.level == position][4::9]
        found = {
            (int(np.abs(grid.x - x).argmin()), int(np.abs(grid.y - y).argmin())): z for x, y, z in middle
        }
        expected = slow_crossings(field, level_m)
        assert found.keys() == expected.keys()
        np.testing.assert_allclose(
            [found[column] for column in expected], list(expected.values()), atol=1e-15
        )


def test_a_gap_is_not_bridged():
    grid = regular((2, 2, 6))
    index = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 3], [0, 0, 4], [1, 1, 2]])
    field = PotentialField(grid, index, [0.0, 1.0, 3.0, 4.0, 0.0])
    heights = [surface_points(field, level).points_m[4::9, 2] for level in (0.25, 2.0, 3.5)]
    assert heights[0] == pytest.approx(grid.z[0] + 0.25 * 0.003)
    assert len(heights[1]) == 0
    assert heights[2] == pytest.approx(grid.z[3] + 0.5 * 0.003)


def test_the_highest_of_several_rises_counts():
    grid = regular((1, 1, 6))
    index = np.argwhere(np.ones(grid.shape, dtype=bool))
    field = PotentialField(grid, index, [0.0, 2.0, 0.0, 2.0, 0.5, 0.0])
    assert surface_points(field, 1.0).points_m[4, 2] == pytest.approx(grid.z[2] + 0.5 * 0.003)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0.3, -0.2, 0.933)])
def test_a_plane_is_met_exactly_on_voxels_that_are_not_cubes(direction):
    field = plane_field(direction)
    normal = np.asarray(direction) / np.linalg.norm(direction)
    for level_m in (-0.004, 0.0013):
        patch = surface_points(field, level_m)
        np.testing.assert_allclose(patch.points_m @ direction, level_m, atol=1e-12)
        np.testing.assert_allclose(patch.normals, np.broadcast_to(normal, patch.normals.shape), atol=1e-9)


def test_areas_add_up_to_the_area_of_the_plane():
    direction = np.array([0.3, -0.2, 0.933])
    field = plane_field(direction, shape=(12, 10, 40))
    normal = direction / np.linalg.norm(direction)
    patch = surface_points(field, 0.011)
    columns = 12 * 10 * BOXES[0] * BOXES[1]
    assert len(patch.points_m) == 9 * 120
    assert patch.areas_m2.sum() == pytest.approx(columns / normal[2], rel=1e-9)


def test_sub_points_tile_the_columns():
    field = plane_field((0, 0, 1), shape=(3, 2, 4))
    points = surface_points(field, field.potential_m.mean()).points_m
    for axis, count in ((0, 9), (1, 6)):
        places = np.unique(points[:, axis].round(9))
        assert len(places) == count
        np.testing.assert_allclose(np.diff(places), BOXES[axis] / 3, atol=2e-9)


@pytest.mark.parametrize("given", [False, True])
def test_a_spherical_field_gives_the_sphere(given):
    field = sphere_field()
    if given:
        position = voxel_positions_m(field.grid, field.index)
        normals = position / np.linalg.norm(position, axis=1, keepdims=True)
        field = PotentialField(field.grid, field.index, field.potential_m, normals)
    for level_m in (-0.006, 0.0, 0.005):
        patch = surface_points(field, level_m)
        radius = np.linalg.norm(patch.points_m, axis=1)
        # A tile's corner leaves the sphere by (edge/sqrt(2) / cos)^2 / (2 r) = 0.12 mm at most, f bends as much.
        assert np.abs(radius - 0.04 - level_m).max() < 0.25e-3
        cosine = np.einsum("pi,pi->p", patch.normals, patch.points_m / radius[:, None])
        # One-sided differences at the rim of the mask are half a voxel off: 1.5 mm of a radius of 40 mm, twice.
        assert np.degrees(np.arccos(cosine.min())) < 6


def test_steep_and_overhanging_normals_are_raised():
    grid = regular((3, 1, 2))
    index = np.argwhere(np.ones(grid.shape, dtype=bool))
    normals = np.repeat([[1.0, 0, 0], [0.6, 0, -0.8], [0, 0, -1.0]], 2, axis=0)
    patch = surface_points(PotentialField(grid, index, np.tile([0.0, 1.0], 3), normals), 0.5)
    steepest = [np.sqrt(0.96), 0, 0.2]
    np.testing.assert_allclose(patch.normals[4::9], [steepest, steepest, [0, 0, 1]], atol=1e-12)
    assert patch.areas_m2.max() == pytest.approx(0.003**2 / 9 / 0.2)


def test_opposite_normals_do_not_cancel_into_nothing():
    grid = regular((1, 1, 3))
    normals = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 1.0]])
    patch = surface_points(
        PotentialField(grid, [[0, 0, 0], [0, 0, 1], [0, 0, 2]], [0.0, 1.0, 2.0], normals), 0.5
    )
    assert np.isfinite(patch.points_m).all() and np.isfinite(patch.normals).all()


def test_all_levels_at_once_are_the_levels_one_by_one():
    field = sphere_field()
    chosen = levels(field, WAVELENGTH_M)
    stack = all_surface_points(field, chosen)
    for position, level_m in enumerate(chosen):
        patch = surface_points(field, level_m)
        for name in ("points_m", "normals", "areas_m2"):
            np.testing.assert_array_equal(getattr(stack, name)[stack.level == position], getattr(patch, name))
        np.testing.assert_array_equal(stack.points_at(position), patch.points_m)
    assert stack.points_at(len(chosen)).shape == (0, 3)


def test_levels_cover_the_whole_range():
    field = plane_field((0, 0, 1), edges_m=(0.003, 0.003, 0.003), shape=(4, 4, 20))
    low, high = field.potential_m.min(), field.potential_m.max()
    chosen = levels(field, WAVELENGTH_M)
    np.testing.assert_allclose(np.diff(chosen), WAVELENGTH_M / 2)
    assert chosen[0] == low and high - WAVELENGTH_M / 2 < chosen[-1] <= high
    np.testing.assert_allclose(levels(field, WAVELENGTH_M, 0.0019), low + 0.0019 * np.arange(len(chosen) + 1))
    # mmNorm's rule.
    margin = levels(field, WAVELENGTH_M, margin_m=0.015)
    assert margin[0] == pytest.approx(low + 0.015) and margin[-1] <= high - 0.015
    np.testing.assert_array_equal(levels(field, WAVELENGTH_M, margin_m=0.015, drop_deepest=5), margin[5:])
    assert len(levels(field, WAVELENGTH_M, margin_m=0.015, drop_deepest=15)) == 0
    assert len(levels(field, WAVELENGTH_M, margin_m=0.05)) == 0


def test_voxel_points_are_eq_6():
    field = plane_field((0, 0, 1), edges_m=(0.003, 0.003, 0.003), shape=(2, 2, 10))
    level_m = field.grid.z[4] + 0.001
    assert set(voxel_points(field, level_m)[:, 2]) == set(field.grid.z[[4, 5]])
    assert set(voxel_points(field, level_m, 0.0011)[:, 2]) == {field.grid.z[4]}
    assert len(voxel_points(field, 1.0)) == 0
    with pytest.raises(RadarError, match="not cubes"):
        voxel_points(plane_field((0, 0, 1)), level_m)
    assert len(voxel_points(plane_field((0, 0, 1)), 0.0, 0.002)) > 0


def test_a_single_voxel_has_one_level_and_no_surface():
    field = PotentialField(regular((3, 3, 3)), np.array([[1, 1, 1]]), np.zeros(1))
    chosen = levels(field, WAVELENGTH_M)
    assert chosen.tolist() == [0.0]
    assert len(all_surface_points(field, chosen).points_m) == 0
    assert len(voxel_points(field, 0.0)) == 1
    assert len(all_surface_points(field, np.empty(0)).points_m) == 0


def test_the_order_of_the_voxels_does_not_matter(rng):
    field = sphere_field()
    order = rng.permutation(len(field.index))
    mixed = PotentialField(field.grid, field.index[order], field.potential_m[order])
    np.testing.assert_array_equal(surface_points(field, 0.0).points_m, surface_points(mixed, 0.0).points_m)


@pytest.mark.parametrize("count", [1, 40, 100, 101, 350])
def test_sampling_gives_exactly_as_many_points(count, rng):
    points = rng.normal(size=(100, 3))
    chosen = sample_points(points, count, np.random.default_rng(0))
    np.testing.assert_array_equal(chosen, sample_points(points, count, np.random.default_rng(0)))
    assert chosen.shape == (count, 3)
    times = [int((chosen == point).all(axis=1).sum()) for point in points]
    assert max(times) - min(times) <= 1 and sum(times) == count
    if count == 40:
        assert not np.array_equal(chosen, sample_points(points, count, np.random.default_rng(1)))


def test_refuses_bad_fields_levels_and_samples():
    grid = regular((3, 3, 3))
    one = np.array([[1, 1, 1]])
    for arguments, message in [
        ((np.empty((0, 3), dtype=int), []), "integers of shape"),
        (([[0.5, 0, 0]], [0.0]), "integers of shape"),
        (([[0, 0, 3]], [0.0]), "beyond the grid"),
        (([[0, 0, 1], [0, 0, 1]], [0.0, 1.0]), "twice"),
        ((one, [np.nan]), "potential_m must be finite"),
        ((one, [0.0, 1.0]), "of shape"),
        ((one, [0.0], [[np.nan, 0, 1]]), "normals must be finite"),
    ]:
        with pytest.raises(RadarError, match=message):
            PotentialField(grid, *arguments)
    field = PotentialField(grid, one, [0.0])
    for bad in ([1.0, 0.0], [np.nan], [[0.0]]):
        with pytest.raises(RadarError, match="ascending"):
            all_surface_points(field, np.array(bad))
    for call in (
        lambda: levels(field, 0.0),
        lambda: levels(field, 0.004, np.nan),
        lambda: levels(field, 0.004, margin_m=-1.0),
        lambda: sample_points(np.empty((0, 3)), 5, np.random.default_rng(0)),
        lambda: sample_points(np.ones((2, 3)), 0, np.random.default_rng(0)),
    ):
        with pytest.raises(RadarError):
            call()
