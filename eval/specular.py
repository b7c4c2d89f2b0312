"""How much of a surface a radar can see: specular reflection, measured on the mesh and in the image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from waveformer.simulator.image import Image
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.radar import Aperture

_MAX_DIRECTIONS = 2000
_BLOCK_FACES = 512


def specular_fraction(mesh: SurfaceMesh, aperture: Aperture, tolerance_deg: float) -> float:
    """Share of the surface area whose normal points at an antenna, shadows not considered.

    Args:
        mesh: in the radar frame.
        aperture: the middle between transmitter and receiver stands for both; thinned to 2000 positions.
        tolerance_deg: largest angle between the normal and the direction of the nearest-aligned antenna.

    Returns:
        Between 0 and 1.
    """
    antennas_m = (aperture.tx_m + aperture.receivers_m) / 2
    antennas_m = antennas_m[:: -(-len(antennas_m) // _MAX_DIRECTIONS)]
    facing = np.zeros(len(mesh.faces), dtype=bool)
    candidates = np.flatnonzero(_may_face(mesh, antennas_m, tolerance_deg))
    centers_m = mesh.triangles_m.mean(axis=1)
    for start in range(0, len(candidates), _BLOCK_FACES):
        block = candidates[start : start + _BLOCK_FACES]
        towards = antennas_m[None] - centers_m[block, None]  # (block, antennas, 3)
        along = np.einsum("fai,fi->fa", towards, mesh.normals[block])
        if mesh.two_sided:
            along = np.abs(along)
        best_cosine = (along / np.linalg.norm(towards, axis=-1)).max(axis=1)
        facing[block] = best_cosine >= np.cos(np.deg2rad(tolerance_deg))
    return float(mesh.areas_m2[facing].sum() / mesh.areas_m2.sum())


def _may_face(mesh: SurfaceMesh, antennas_m: NDArray[np.float64], tolerance_deg: float) -> NDArray[np.bool_]:
    """Faces whose normal points at the sphere around all antennas, give or take the tolerance, shape (F,)."""
    middle_m = antennas_m.mean(axis=0)
    radius_m = np.linalg.norm(antennas_m - middle_m, axis=1).max()
    towards = middle_m - mesh.triangles_m.mean(axis=1)
    distance_m = np.linalg.norm(towards, axis=1)
    cosine = np.einsum("fi,fi->f", towards, mesh.normals) / distance_m
    reach = np.deg2rad(tolerance_deg) + np.arcsin(np.minimum(1.0, radius_m / distance_m))
    return np.asarray(
        (np.abs(cosine) if mesh.two_sided else cosine) >= np.cos(np.minimum(reach, np.pi)) - 1e-9
    )


def bright_fraction(mesh: SurfaceMesh, image: Image, level_db: float) -> float:
    """Share of the surface area on which |image| is at least `level_db` relative to its peak.

    Args:
        mesh: in the radar frame; what lies outside the grid counts as dark.
        image: interpolated linearly; every axis needs at least two voxels.
        level_db: negative.

    Returns:
        Between 0 and 1; 0 for an empty image.
    """
    magnitude = np.abs(image.values)
    threshold = float(magnitude.max()) * 10 ** (level_db / 20)
    if threshold == 0.0:
        return 0.0
    axes = (image.grid.x, image.grid.y, image.grid.z)
    lookup = RegularGridInterpolator(axes, magnitude, bounds_error=False, fill_value=0.0)
    bright = lookup(mesh.triangles_m.mean(axis=1)) >= threshold
    return float(mesh.areas_m2[bright].sum() / mesh.areas_m2.sum())
