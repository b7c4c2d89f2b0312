"""Volume of the smallest box, of any orientation, around points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Points thinner than this share of their length are flat: the hull of rounding errors is meaningless.
_FLAT = 1e-9


def box_exceeds(points_m: NDArray[np.float64], volume_m3: float) -> bool:
    """Whether the smallest oriented box around points is larger than a volume.

    The axis-parallel box is never smaller, so the hull is computed only where that box is too large.

    Args:
        points_m: shape (P, 3); no point fits any box.
        volume_m3: the limit.
    """
    if len(points_m) == 0 or np.prod(np.ptp(points_m, axis=0)) <= volume_m3:
        return False
    return oriented_box_volume_m3(points_m) > volume_m3


def oriented_box_volume_m3(points_m: NDArray[np.float64]) -> float:
    """Volume of the oriented box around points, zero where they lie in a plane or on a line.

    Boxes flush with a face of the convex hull are tried (`trimesh.bounds.oriented_bounds`); a box along the
    principal axes would be quicker but exceeds the smallest one, for a cube seen cornerwise by a factor of 2.

    Args:
        points_m: shape (P, 3), P at least 1.
    """
    centred = points_m - points_m.mean(axis=0)
    spread = np.linalg.svd(centred, compute_uv=False)
    if len(points_m) < 4 or spread[2] <= _FLAT * spread[0]:
        return 0.0
    from trimesh.bounds import oriented_bounds

    return float(np.prod(oriented_bounds(centred)[1]))
