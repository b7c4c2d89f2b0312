"""Smooth convex mirrors focus inside themselves, towards their centre of curvature: why a bright voxel is no surface.

The echo of a sphere comes from the point that faces the antenna, at range |p - c| - r. All these ways continue to the
centre c, so that the image of k |p - c| is sharp there; only the range resolution pulls it back to the surface.
"""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator import Aperture, Chirp, Grid, focus, primitives, simulate

CHIRP = Chirp(77.5001e9, 3.0009e9, 32)
APERTURE = Aperture.planar_grid(50, 60, 0.004)
TOP_M = -0.38


def bright_depths_m(radius_m: float, flat: bool = False) -> np.ndarray:
    """Height of the bright voxels over the object's top."""
    shape = primitives.plate(0.08, 0.08) if flat else primitives.sphere(radius_m)
    shape.apply_translation([0.0, 0.0, TOP_M - (0.0 if flat else radius_m)])
    image = focus(
        simulate(shape, CHIRP, APERTURE),
        Grid.box((-0.03, -0.03, TOP_M - 0.08), (0.03, 0.03, TOP_M + 0.04), 0.003),
        normals=False,
    )
    magnitude = np.abs(image.image)
    bright = np.argwhere(magnitude > 0.5 * magnitude.max())
    return np.asarray(image.grid.z[bright[:, 2]] - TOP_M)


@pytest.mark.parametrize("radius_m", [0.02, 0.04])
def test_a_ball_shines_inside_itself(mitsuba_variant: None, radius_m: float) -> None:
    depths_m = bright_depths_m(radius_m)
    # a plate, below, stays within 5 mm
    assert np.median(depths_m) < -8e-3
    assert (depths_m < 0.0).mean() > 0.75


def test_a_plate_shines_where_it_is(mitsuba_variant: None) -> None:
    # half a range bin of 5 cm to both sides, symmetric
    assert abs(np.median(bright_depths_m(0.0, flat=True))) < 5e-3
