"""How an object comes to rest on a plane: dropped in some orientation, it rolls over edges until it is stable.

It lies on a face of its convex hull and is stable where its centre of mass, taken as the hull's, stands above that face;
else it rolls over the edge beyond which the centre stands (quasi-static: no bouncing).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

_DOWN = np.array([0.0, 0.0, -1.0])
_EDGE_TOLERANCE = 1e-9


def resting_rotation(vertices_m: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """A rotation (3, 3) after which an object can lie on a level plane, turned about z at random.

    Args:
        vertices_m: (V, 3).
        rng: draws the orientation in which the object is dropped, and the turn about z.
    """
    from scipy.spatial import ConvexHull, QhullError

    down = Rotation.random(random_state=rng).apply(_DOWN)  # in the object's frame
    around = Rotation.from_euler("z", rng.uniform(0.0, 360.0), degrees=True)
    try:
        hull = ConvexHull(vertices_m)
    except QhullError:  # a flat object, on one of its sides
        axis = np.linalg.svd(vertices_m - vertices_m.mean(axis=0), full_matrices=False)[2][-1]
        normal = axis if axis @ down > 0 else -axis
    else:
        normal = hull.equations[_stable_face(hull, vertices_m, down), :3]
    lying, _ = Rotation.align_vectors(_DOWN[None], normal[None])
    return np.asarray((around * lying).as_matrix())


def center_of_hull(vertices_m: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Centre of mass of a convex body of uniform density, (3,); its faces may be wound either way."""
    inside = vertices_m[np.unique(faces)].mean(axis=0)
    corners = vertices_m[faces] - inside
    volumes = np.abs(np.linalg.det(corners))
    return np.asarray(inside + (volumes[:, None] * corners.sum(axis=1)).sum(axis=0) / (4.0 * volumes.sum()))


def _stable_face(hull: Any, vertices_m: NDArray[np.float64], down: NDArray[np.float64]) -> int:
    """The face of the hull on which an object ends that meets the plane first where `down` points."""
    normals = hull.equations[:, :3]
    center = center_of_hull(vertices_m, hull.simplices)
    height_m = -(normals @ center + hull.equations[:, 3])  # of the centre over every face
    facing = normals @ down
    face = int(np.argmin(np.where(facing > 0, height_m / np.where(facing > 0, facing, 1.0), np.inf)))
    for _ in range(len(normals)):  # each roll brings the centre down, so no face comes twice
        a, b, c = vertices_m[hull.simplices[face]]
        foot = center + height_m[face] * normals[face]
        within = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), foot - a, rcond=None)[0]
        share = np.array([1.0 - within.sum(), *within])  # barycentric
        if share.min() >= -_EDGE_TOLERANCE:
            break
        face = int(hull.neighbors[face][np.argmin(share)])  # opposite the corner it is farthest from
    return face
