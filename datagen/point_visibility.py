"""Which points of a surface a radar could see if it were a camera: by rays on the mesh, or from the points alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.target import rotate

# Of 10 to 3000 the ratio that agrees best with rays, on 16 scans of 16,384 points (docs/partials.md).
FLIP_RATIO = 300.0


def facing_normals(
    points_m: NDArray[np.float64], normals: NDArray[np.float64], viewpoint_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Normals (P, 3) turned over where they point away from a viewpoint (3,), for surfaces that have no outside."""
    away = np.einsum("pi,pi->p", normals, viewpoint_m - points_m) < 0
    return np.where(away[:, None], -normals, normals)


def visible_rays(
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    scene: Any,
    viewpoint_m: NDArray[np.float64],
    pose: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Whether points face a viewpoint and nothing of the mesh lies between, (P,).

    One viewpoint stands for the radar, the middle of its aperture: what its corners see besides are walls that mirror
    nothing back, and rims of shadows.

    Args:
        points_m, normals: of the mesh's surface, (P, 3), radar frame.
        scene: of `simulator.scene.build_scene`.
        viewpoint_m: (3,), radar frame.
        pose: rigid transform (4, 4) from the scene's frame to the radar frame, so that one scene serves all views of an
            object; None if they are the same.
    """
    from waveformer.simulator.scene import VISIBLE, SampleTable, sample_states

    if pose is not None:
        # The inverse of a rotation is its transpose.
        points_m, normals = rotate(points_m - pose[:3, 3], pose.T), rotate(normals, pose.T)
        viewpoint_m = rotate((viewpoint_m - pose[:3, 3])[None], pose.T)[0]
    table = SampleTable(points_m, normals)
    return np.asarray(sample_states(scene, table, False, viewpoint_m[None], None)[0] == VISIBLE)


def visible_hidden_point_removal(
    points_m: NDArray[np.float64], viewpoint_m: NDArray[np.float64], flip_ratio: float = FLIP_RATIO
) -> NDArray[np.bool_]:
    """Whether points are visible from a viewpoint, judged without a surface: the paper's option.

    Points are flipped to the far side of a sphere around the viewpoint, p -> p (2 R / |p| - 1); those on the convex hull
    of the result and the viewpoint are visible (Katz, Tal & Basri 2007, "Direct visibility of point sets", section 3).

    Args:
        points_m: (P, 3), none at the viewpoint.
        viewpoint_m: (3,).
        flip_ratio: R over the distance of the farthest point, at least 1; larger ones find more points visible, also wrong
            ones.

    Raises:
        MeshError: ``visibility.viewpoint``: a point lies at the viewpoint; ``visibility.hull``: fewer than three points, or
            all in one plane with the viewpoint.
    """
    from scipy.spatial import ConvexHull, QhullError

    offset_m = points_m - viewpoint_m
    distance_m = np.linalg.norm(offset_m, axis=1, keepdims=True)
    if (distance_m == 0).any():
        raise MeshError(
            "visibility.viewpoint", "a point lies at the viewpoint: move the object off the radar"
        )
    flipped = offset_m * (2 * flip_ratio * distance_m.max(initial=0.0) / distance_m - 1)
    try:
        corners = ConvexHull(np.concatenate([flipped, np.zeros((1, 3))])).vertices
    except (QhullError, ValueError):
        raise MeshError(
            "visibility.hull",
            f"hidden-point removal needs points around a solid angle, got {len(points_m)} in one plane with the viewpoint; "
            "use rays",
        ) from None
    visible = np.zeros(len(points_m) + 1, dtype=bool)
    visible[corners] = True
    return visible[:-1]
