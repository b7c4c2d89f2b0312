"""The way by a flat mirror: from transmitter to receiver by the image of one of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def heights_over(
    positions_m: NDArray[np.float64], point_m: NDArray[np.float64], normal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Signed distance of positions (N, 3) from a plane, shape (N,)."""
    return np.asarray((positions_m - point_m) @ normal)


def way_by_plane(
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64],
    point_m: NDArray[np.float64],
    normal: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Length of the mirrored way of every pair, and where it meets the plane.

    Args:
        tx_m, rx_m: antennas on one side of the plane, shape (N, 3).
        point_m, normal: of the plane; the normal is a unit vector, either way round.

    Returns:
        Length in metres (N,), and the mirror's point (N, 3).
    """
    height_tx, height_rx = (heights_over(antennas, point_m, normal) for antennas in (tx_m, rx_m))
    image_m = rx_m - 2.0 * height_rx[:, None] * normal
    share = height_tx / (height_tx + height_rx)
    return np.linalg.norm(tx_m - image_m, axis=1), tx_m + share[:, None] * (image_m - tx_m)
