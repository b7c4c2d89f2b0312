"""The direct image against Eq. 1 and mmNorm's votes in float64."""

from __future__ import annotations

import numpy as np

from waveformer.simulator import Aperture, Chirp, Grid, simulate_points
from waveformer.simulator.direct_image import direct_image
from waveformer.simulator.reference_focus import dense_focus

CHIRP = Chirp(77.5001e9, 3.0009e9, 32)
GRID = Grid.box((-0.02, -0.015, -0.36), (0.022, 0.014, -0.33), 0.003)
POINTS_M = np.array([[0.0, 0.0, -0.345], [0.012, -0.006, -0.352], [-0.015, 0.01, -0.337]])


def test_direct_image_is_eq_1(mitsuba_variant: None) -> None:
    tx_m = Aperture.planar_grid(20, 24, 0.008).tx_m
    scan = simulate_points(POINTS_M, np.full(3, 1e-3), CHIRP, Aperture(tx_m, tx_m + [0.03, 0.0, 0.0]))
    found, expected = direct_image(scan, GRID), dense_focus(scan, GRID)
    strong = np.abs(expected.image) > 0.2 * np.abs(expected.image).max()
    # linear interpolation over 1.5 mm: (pi 1.5 / 50)^2 / 8 at the ends of the band, seen at a fifth of the peak
    assert np.abs(found.image - expected.image)[strong].max() < 2e-3 * np.abs(expected.image).max()
    assert found.normals is not None
    assert expected.normals is not None
    assert (found.normals * expected.normals).sum(axis=-1)[strong].min() > np.cos(np.radians(0.3))
    plain = direct_image(scan, GRID, normals=False)
    assert plain.normals is None
    assert np.allclose(plain.image, found.image, rtol=1e-4, atol=1e-4 * np.abs(found.image).max())
