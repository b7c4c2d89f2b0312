"""What of an object is lit from a point."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from waveformer.simulator.errors import MeshError
from waveformer.simulator.mesh import load_mesh
from waveformer.simulator.rigid_pose import RigidPose

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

VIEW_M = np.zeros(3)
BELOW = RigidPose(np.eye(3), np.array([0.0, 0.0, -0.4]))
UPSIDE_DOWN = BELOW.moved([0, 0, 0, np.pi, 0, 0])


def step() -> trimesh.Trimesh:
    """A low plate, half of it under a higher one: 4 x 2 cm and 2 x 2 cm seen from above."""
    low = trimesh.creation.box((0.04, 0.02, 0.002))
    high = trimesh.creation.box((0.02, 0.02, 0.002))
    high.apply_translation([0.01, 0.0, 0.01])
    both = trimesh.util.concatenate([low, high])
    both.apply_translation([0.3, 0.2, 0.1])  # the frame of the mesh is nowhere near
    return both


def test_what_lies_in_a_shadow_is_left_out() -> None:
    from waveformer.simulator.pose_body import Body

    lit = Body(load_mesh(step()), 0.004).lit(BELOW, VIEW_M, 0.5, 0.9)
    # all of 4 x 2 cm once, but for the sight line that passes the high plate at 2 degrees: 0.4 mm, and a sample
    assert lit.areas_m2.sum() == pytest.approx(8e-4, rel=0.05)
    assert (lit.normals[:, 2] > 0.999).all()
    covered = lit.points_m[:, 0] > 0.001
    assert np.ptp(lit.points_m[covered, 2]) < 1e-6
    np.testing.assert_allclose(np.abs(lit.points_m).max(axis=0)[:2], [0.02, 0.01], atol=2e-3)


def test_the_pose_turns_what_is_lit() -> None:
    from waveformer.simulator.pose_body import Body

    lit = Body(load_mesh(step()), 0.004).lit(UPSIDE_DOWN, VIEW_M, 0.5, 0.9)
    assert (lit.normals[:, 2] < -0.999).all()


def test_normals_of_a_sheet_point_to_the_side_that_is_seen() -> None:
    from waveformer.simulator.pose_body import Body

    corners = np.array([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0], [0, 0.02, 0.001]])
    sheet = load_mesh(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False))
    assert sheet.two_sided
    for pose, sign in ((BELOW, 1.0), (UPSIDE_DOWN, -1.0)):
        lit = Body(sheet, 0.004).lit(pose, VIEW_M, 0.5, 0.5)
        assert len(lit.points_m) > 50
        assert (sign * lit.normals[:, 2] > 0.9).all()


def test_an_object_that_shows_nothing_is_refused() -> None:
    from waveformer.simulator.pose_body import Body

    edge_on = BELOW.moved([0, 0, 0, 0, np.pi / 2, 0])
    sheet = trimesh.Trimesh([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0]], [[0, 1, 2]], process=False)
    with pytest.raises(MeshError, match="faces the aperture"):
        Body(load_mesh(sheet), 0.004).lit(edge_on, VIEW_M, 0.5, 0.5)
