"""Geometric partials: the part of a surface that a radar sees, from the mesh alone (Wave-Former paper, Eq. 2 and 3).

Eq. 2  keeps points that some sensor sees within tau of their normal, so that the echo comes back, and that are visible;
Eq. 3  keeps points that are tilted by less than tau_H and tau_V from the radar, as a weaker material would have it.

`view_of` finds what does not depend on chance, once per view; `draw_partial` draws the angles and the noise of a sample.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from waveformer.datagen.farthest_points import farthest_order
from waveformer.datagen.partial_noise import PartialNoise, Span, add_noise
from waveformer.datagen.point_visibility import facing_normals, visible_hidden_point_removal, visible_rays
from waveformer.datagen.specular_angles import specular_alignment
from waveformer.datagen.specular_tilt import literal_angles_deg, tilt_deg
from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.simulator.errors import MeshError
from waveformer.simulator.radar import Aperture

NUM_POINTS = 2048
# The ranges of tau that training draws from: with the sensors known, and with one sensor standing for all.
_TAU_DEG = {"true": (2.0, 20.0), "centre": (15.0, 40.0)}
_TILTS = {"tilt": tilt_deg, "literal": literal_angles_deg}


class PartialSettings(BaseModel):
    """Ranges from which each sample draws its angles, uniformly; two equal values fix one.

    Attributes:
        aperture: sensors of Eq. 2: "true", all there are, or "centre", one in their middle, for radars of unknown extent.
        tau_deg: of Eq. 2; None means 2 .. 20 with the true aperture and 15 .. 40 with its centre.
        reading: of Eq. 3: "tilt" from boresight, "literal" as printed (it removes the surface that faces the radar), or
            "none" of it.
        tau_h_deg, tau_v_deg: of Eq. 3.
        visibility: by "rays" on the mesh or by "hidden_point_removal".
        noise: None means points on the surface.
        num_points: at most so many; more are thinned by farthest-point sampling.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    aperture: Literal["true", "centre"] = "true"
    tau_deg: Span | None = None
    reading: Literal["tilt", "literal", "none"] = "tilt"
    tau_h_deg: Span = (10.0, 40.0)
    tau_v_deg: Span = (10.0, 40.0)
    visibility: Literal["rays", "hidden_point_removal"] = "rays"
    noise: PartialNoise | None = PartialNoise()
    num_points: Annotated[int, Field(ge=1)] = NUM_POINTS


@dataclass(frozen=True, eq=False)
class PartialView:
    """One object before the radar.

    Attributes:
        truth: in the radar frame, P points.
        normals: of these points, turned towards the radar where the surface has no outside, (P, 3).
        visible: from the middle of the aperture, (P,).
        sensors_m: middles between transmitters and receivers, (N, 3).
    """

    truth: TruthCloud
    normals: NDArray[np.float64]
    visible: NDArray[np.bool_]
    sensors_m: NDArray[np.float64]

    @property
    def viewpoint_m(self) -> NDArray[np.float64]:
        """The middle of the aperture, (3,)."""
        return _middle(self.sensors_m)

    @cached_property
    def angle_deg(self) -> NDArray[np.float64]:
        """Smallest angle of Eq. 2 over all sensors, (P,)."""
        return specular_alignment(self.truth.points_m, self.normals, self.sensors_m).angle_deg

    @cached_property
    def centre_angle_deg(self) -> NDArray[np.float64]:
        """The angle of Eq. 2 for a sensor in the middle, (P,)."""
        return specular_alignment(self.truth.points_m, self.normals, self.viewpoint_m[None]).angle_deg


@dataclass(frozen=True, eq=False)
class Partial:
    """What a radar sees of an object.

    Attributes:
        points_m: (P, 3) radar frame, each next point the farthest from all before it (without noise); P = 0 if nothing
            faces the radar.
        index: row of the truth that each point comes from, (P,); -1 for outliers.
        parameters: what was drawn, and how many points there were before thinning, JSON values.
    """

    points_m: NDArray[np.float64]
    index: NDArray[np.int64]
    parameters: dict[str, Any]


def view_of(
    truth: TruthCloud,
    aperture: Aperture,
    scene: Any,
    *,
    two_sided: bool,
    pose: NDArray[np.float64] | None = None,
    visibility: Literal["rays", "hidden_point_removal"] = "rays",
) -> PartialView:
    """What the partials of one view have in common.

    Args:
        truth: with normals, in the radar frame.
        aperture: true sensors.
        scene: of `simulator.scene.build_scene`; unused by hidden-point removal.
        two_sided: as `SurfaceMesh.two_sided`: the normals may point either way.
        pose: rigid transform (4, 4) from the scene's frame to the radar frame; None if they are the same.
        visibility: as in `PartialSettings`.

    Raises:
        MeshError: ``truth.normals``: there are none; or as `visible_hidden_point_removal`.
    """
    if truth.normals is None:
        raise MeshError("truth.normals", "ground truth has no normals: partials need those of the surface")
    sensors_m = (aperture.tx_m + aperture.receivers_m) / 2
    viewpoint_m = _middle(sensors_m)
    normals = facing_normals(truth.points_m, truth.normals, viewpoint_m) if two_sided else truth.normals
    if visibility == "rays":
        visible = visible_rays(truth.points_m, normals, scene, viewpoint_m, pose)
    else:
        visible = visible_hidden_point_removal(truth.points_m, viewpoint_m)
    return PartialView(truth, normals, visible, sensors_m)


def draw_partial(view: PartialView, settings: PartialSettings, rng: np.random.Generator) -> Partial:
    """One partial of a view.

    Args:
        view: visible points, by the settings' own rule (`view_of`).
        settings: ranges.
        rng: random numbers: angles first, then noise, so that noise changes no angle.

    Returns:
        The partial; it may be empty.
    """
    is_true = settings.aperture == "true"
    spans = (settings.tau_deg or _TAU_DEG[settings.aperture], settings.tau_h_deg, settings.tau_v_deg)
    tau, tau_h, tau_v = (float(rng.uniform(*span)) for span in spans)
    parameters: dict[str, Any] = {"aperture": settings.aperture, "tau_deg": tau}
    kept = view.visible & ((view.angle_deg if is_true else view.centre_angle_deg) < tau)  # Eq. 2
    if settings.reading != "none":  # Eq. 3
        horizontal, vertical = _TILTS[settings.reading](view.normals)
        kept &= (horizontal < tau_h) & (vertical < tau_v)
        parameters |= {"reading": settings.reading, "tau_h_deg": tau_h, "tau_v_deg": tau_v}

    rows = np.flatnonzero(kept)
    parameters["kept_points"] = len(rows)
    rows = rows[farthest_order(view.truth.points_m[rows], settings.num_points)]
    points_m = view.truth.points_m[rows]
    if settings.noise is not None:
        noisy = add_noise(points_m, view.normals[rows], view.truth, view.viewpoint_m, settings.noise, rng)
        points_m, rows = noisy.points_m, np.where(noisy.is_outlier, -1, rows)
        parameters["noise"] = noisy.parameters
    return Partial(points_m, rows, parameters)


def _middle(sensors_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the box around all sensors: where they are denser does not matter."""
    return np.asarray((sensors_m.min(axis=0) + sensors_m.max(axis=0)) / 2)
