"""The way by a mirror obeys the law of reflection."""

from __future__ import annotations

import numpy as np

from waveformer.simulator.plane_image import heights_over, way_by_plane


def test_the_mirrored_way_touches_the_plane_at_equal_angles(rng: np.random.Generator) -> None:
    normal = np.array([0.2, -0.4, 1.0]) / np.linalg.norm([0.2, -0.4, 1.0])
    point = np.array([0.0, 0.1, -0.5])
    tx, rx = rng.uniform(-0.2, 0.2, (20, 3)), rng.uniform(-0.2, 0.2, (20, 3))
    for sign in (1.0, -1.0):
        length, mirror_point = way_by_plane(tx, rx, point, sign * normal)
        assert np.allclose(heights_over(mirror_point, point, normal), 0.0, atol=1e-12)
        ways = tx - mirror_point, rx - mirror_point
        distances = [np.linalg.norm(way, axis=1) for way in ways]
        assert np.allclose(length, sum(distances), atol=1e-12)
        cosines = [way @ normal / distance for way, distance in zip(ways, distances, strict=True)]
        assert np.allclose(*cosines, atol=1e-12)
        assert np.allclose(np.cross(*ways) @ normal, 0.0, atol=1e-12)  # one plane of incidence
