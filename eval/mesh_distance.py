"""Signed distance of points to a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.datagen.truth_cloud import finite_points
from waveformer.simulator.mesh import SurfaceMesh


def signed_distance_m(points_m: ArrayLike, mesh: SurfaceMesh) -> NDArray[np.float64]:
    """Distance of points to the nearest point of a mesh, negative behind it, exact.

    The sign is that of the angle-weighted normal there (Baerentzen and Aanaes 2005). Where the mesh is open or
    wound inconsistently, only the magnitude means something.

    Args:
        points_m: (P, 3) metres.
        mesh: in the same frame.

    Returns:
        Shape (P,).

    Raises:
        MeshError: the points have another shape or are not finite.
    """
    import pyvista as pv

    points = finite_points("points", points_m)
    if len(points) == 0:
        return np.empty(0)
    # VTK fails on read-only arrays, hence the copies.
    surface = pv.PolyData.from_regular_faces(np.array(mesh.vertices_m), np.array(mesh.faces))
    measured: Any = pv.PolyData(np.array(points)).compute_implicit_distance(surface)
    return np.asarray(measured["implicit_distance"], dtype=np.float64)
