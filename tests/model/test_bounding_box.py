import numpy as np
import pytest

from waveformer.model.bounding_box import box_exceeds, oriented_box_volume_m3


def turned(points, rng):
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return points @ rotation.T + rng.normal(size=3)


def lattice(*counts):
    return np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)


def test_a_turned_cuboid_has_the_volume_of_the_cuboid(rng):
    points = lattice(5, 4, 8) * 0.05
    # trimesh rounds the direction of a hull face to 0.1 degree before it tries it: 0.2 % of each edge at most.
    assert oriented_box_volume_m3(turned(points, rng)) == pytest.approx(0.2 * 0.15 * 0.35, rel=1e-2)


@pytest.mark.parametrize("counts", [(1, 1, 1), (2, 1, 1), (3, 1, 1), (9, 7, 1), (40, 1, 1)])
def test_flat_points_have_no_volume(counts, rng):
    points = turned(lattice(*counts), rng)
    assert oriented_box_volume_m3(points) == 0.0
    assert not box_exceeds(points, 0.03)


def test_a_long_diagonal_bar_fits_although_its_axis_parallel_box_does_not(rng):
    bar = lattice(60, 4, 4) * 0.01
    diagonal = np.linalg.qr(np.column_stack([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]))[0]
    points = bar @ diagonal.T
    assert np.prod(np.ptp(points, axis=0)) > 0.03
    assert not box_exceeds(points, 0.03)
    assert box_exceeds(2 * lattice(20, 20, 20) * 0.01, 0.03)


def test_no_point_fits():
    assert not box_exceeds(np.empty((0, 3)), 0.03)
