import numpy as np
import pytest

from waveformer.model.components import NEIGHBOURS, connected_components, neighbour_table
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid


def regular(shape, edges_m=(0.01, 0.01, 0.01)):
    return Grid(*(np.arange(count) * edge for count, edge in zip(shape, edges_m, strict=True)))


def test_faces_connect_edges_and_corners_do_not():
    mask = np.zeros((4, 4, 4), dtype=bool)
    mask[0, 0, 0] = mask[0, 0, 1] = True
    mask[1, 1, 1] = True
    mask[2, 1, 2] = True
    found = connected_components(mask, regular(mask.shape), minimum_volume_m3=0.0)
    assert [part.tolist() for part in found] == [[[0, 0, 0], [0, 0, 1]], [[1, 1, 1]], [[2, 1, 2]]]
    assert found[0].dtype == np.int64


def test_largest_first_and_c_order(rng):
    mask = rng.random((12, 11, 10)) < 0.3
    grid = regular(mask.shape)
    found = connected_components(mask, grid, minimum_volume_m3=0.0)
    sizes = [len(part) for part in found]
    assert sizes == sorted(sizes, reverse=True) and sum(sizes) == mask.sum()
    for part in found:
        flat = np.ravel_multi_index(part.T, mask.shape)
        assert (np.diff(flat) > 0).all()
    assert {tuple(row) for part in found for row in part} == {tuple(row) for row in np.argwhere(mask)}


@pytest.mark.parametrize("edges_m", [(0.001, 0.001, 0.001), (0.003, 0.003, 0.003), (0.002, 0.003, 0.005)])
def test_limits_are_physical(edges_m):
    """36 ml by default, 4.5 ml where nothing is larger, whatever the voxel."""
    voxels_per_ml = 1e-6 / np.prod(edges_m)
    for volumes_ml, expected in [((37, 5), 1), ((35, 5), 2), ((5, 4), 1), ((4, 3), 0)]:
        mask = np.zeros((3, 200 * 200), dtype=bool)
        for layer, volume_ml in zip((0, 2), volumes_ml, strict=True):
            mask[layer, : round(volume_ml * voxels_per_ml)] = True
        mask = mask.reshape(3, 200, 200)
        assert len(connected_components(mask, regular(mask.shape, edges_m))) == expected, volumes_ml


def test_a_component_must_be_larger_than_the_limit():
    mask = np.ones((3, 4, 10), dtype=bool)  # 120 voxels of 1 ml
    grid = regular(mask.shape)
    assert connected_components(mask, grid, minimum_volume_m3=120e-6, fallback_volume_m3=120e-6) == []
    assert len(connected_components(mask, grid, minimum_volume_m3=119e-6)) == 1


def test_an_empty_mask_has_no_component():
    assert connected_components(np.zeros((3, 3, 3), dtype=bool), regular((3, 3, 3))) == []


def test_refuses_a_mask_of_another_shape():
    with pytest.raises(RadarError, match="does not fit the grid"):
        connected_components(np.ones((2, 3, 3), dtype=bool), regular((3, 3, 3)))


def test_neighbour_table(rng):
    component = np.argwhere(rng.random((5, 6, 7)) < 0.5)
    rows = {tuple(voxel): row for row, voxel in enumerate(component)}
    table = neighbour_table(component)
    for voxel, neighbours in zip(component, table, strict=True):
        expected = [rows.get(tuple(voxel + step), len(component)) for step in NEIGHBOURS]
        assert neighbours.tolist() == expected
