"""A rigid object as a search for its pose sees it: samples in its own axes, lit from one point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.quadrature import SurfaceSamples, sample_surface
from waveformer.simulator.rigid_pose import RigidPose
from waveformer.simulator.scene import VISIBLE, SampleTable, build_scene, sample_states


@dataclass(frozen=True, eq=False)
class BodySamples:
    """Lit samples of a surface, relative to the object's middle and in its own axes.

    Attributes:
        points_m: shape (S, 3).
        normals: towards the lit side, unit, shape (S, 3).
        areas_m2: shape (S,).
        taper: scale of the form factor, see `factorisation.taper_scale`, shape (S,).
    """

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    areas_m2: NDArray[np.float64]
    taper: NDArray[np.float64]


class Body:
    """An object, cut into samples and traced in its own axes, so that its scene is built once for all poses.

    Args:
        mesh: the object.
        wavelength_m: at the centre of the band.
    """

    def __init__(self, mesh: SurfaceMesh, wavelength_m: float) -> None:
        low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
        self.mesh, self._wavelength_m = mesh, wavelength_m
        self.middle_m: NDArray[np.float64] = 0.5 * (low + high)
        self._scene = build_scene([(mesh.vertices_m - self.middle_m, mesh.faces)])
        self._tables: dict[float, tuple[SurfaceSamples, SampleTable]] = {}

    def lit(
        self, pose: RigidPose, view_m: NDArray[np.float64], spacing_wavelengths: float, least_cosine: float
    ) -> BodySamples:
        """Samples that a point sees.

        Args:
            pose: of the object.
            view_m: the point in the radar frame, shape (3,).
            spacing_wavelengths: longest edge of a piece of the surface.
            least_cosine: samples whose normals are farther off the line of sight are left out: their echoes go
                elsewhere.

        Raises:
            MeshError: nothing is left.
        """
        samples, table = self._table(spacing_wavelengths)
        view = (view_m - pose.center_m) @ pose.rotation
        states = sample_states(self._scene, table, self.mesh.two_sided, view[None], None)[0]
        towards = view - samples.points_m
        towards /= np.linalg.norm(towards, axis=1)[:, None]
        cosine = np.einsum("si,si->s", samples.normals, towards)
        index = np.flatnonzero((states == VISIBLE) & (np.abs(cosine) > least_cosine))
        if len(index) == 0:
            raise MeshError("mesh.unseen", f"{self.mesh.name}: no part of it faces the aperture in this pose")
        side = np.where(cosine[index] < 0.0, -1.0, 1.0)
        return BodySamples(
            samples.points_m[index],
            samples.normals[index] * side[:, None],
            samples.areas_m2[index],
            taper_scale(samples, self._wavelength_m, True)[index],
        )

    def _table(self, spacing_wavelengths: float) -> tuple[SurfaceSamples, SampleTable]:
        if spacing_wavelengths not in self._tables:
            shift = np.eye(4)
            shift[:3, 3] = -self.middle_m
            samples = sample_surface(self.mesh, shift, spacing_wavelengths * self._wavelength_m)
            self._tables[spacing_wavelengths] = samples, SampleTable(samples.points_m, samples.normals)
        return self._tables[spacing_wavelengths]
