"""How far surfaces are tilted from the radar: Eq. 3 of the Wave-Former paper, in two readings.

Eq. 3 keeps points whose specular direction lies within tau_H horizontally and tau_V vertically. The specular direction
of a radar that hears itself is the normal. The aperture looks along -z, so the boresight is the z axis of normals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def tilt_deg(normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What Eq. 3 means: the tilt from boresight in the horizontal (x, z) and in the vertical (y, z) plane.

    Args:
        normals: (P, 3) in the radar frame, towards the radar.

    Returns:
        Both angles, (P,) each, 0 (facing the radar) .. 180.
    """
    x, y, z = normals.T
    return np.rad2deg(np.abs(np.arctan2(x, z))), np.rad2deg(np.abs(np.arctan2(y, z)))


def literal_angles_deg(
    normals: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What Eq. 3 says: the angles between the normal and the x and y axes.

    A surface that faces the radar is 90 degrees from both, and no direction is less than 45 degrees from both: the mask
    removes what the radar sees. Here to compare with.

    Args:
        normals: as for `tilt_deg`.

    Returns:
        Both angles, (P,) each, 0 .. 180.
    """
    horizontal, vertical = np.rad2deg(np.arccos(np.clip(normals[:, :2], -1.0, 1.0))).T
    return horizontal, vertical
