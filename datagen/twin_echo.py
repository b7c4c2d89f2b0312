"""The signal of an object under several conditions that share its echo."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.twin_conditions import Condition
from waveformer.datagen.twin_scene import TwinScene
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.simulator.errors import MeshError
from waveformer.simulator.forward_model import ForwardModel
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.materials import Material
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import Aperture
from waveformer.simulator.sheet_echo import sheet_echo
from waveformer.simulator.target import Target


@dataclass(frozen=True, eq=False)
class IdealEcho:
    """What reaches the radar, before its front end.

    Attributes:
        h: shape (N, T) complex64.
        antennas: where the N pairs really are.
        description: of the scene, JSON values.
        seconds: that it took.
    """

    h: NDArray[np.complex64]
    antennas: Aperture
    description: Mapping[str, Any]
    seconds: float


def ideal_echo(scene: TwinScene, condition: Condition, settings: TwinSettings) -> IdealEcho:
    """The echo of an object, and of the sheet in front of it, for all conditions with the same `echo_key`.

    The object is a conductor whose echo is weakened by one real factor; the sheet's own echo is not.

    Raises:
        MeshError, RadarError: as `simulate`, and ``mesh.through_sheet`` if the object is higher than the sheet.
    """
    from waveformer.datagen.twin_tessellation import divide_irregularly, without_hidden_faces

    started = time.perf_counter()
    object_id, sheet = scene.item.object_id, condition.sheet
    if sheet is not None:
        _check_below(scene, float(np.asarray(sheet.point_m)[2]) - sheet.thickness_m)
    mesh = divide_irregularly(
        scene.mesh, settings.tessellation, settings.generator("tessellation", object_id)
    )
    model = ForwardModel.prepare(
        Target(mesh, Material.pec(), scene.pose),
        settings.chirp,
        settings.aperture,
        sheets=() if sheet is None else (replace(sheet, echo=False),),
        front_end=condition.front_end,
        mode=settings.numerics,
        seed=settings.front_end_seed(object_id),
    )
    summed = without_hidden_faces(model) if settings.numerics.direct else model
    h = np.float32(scene.reflectivity) * summed.echo(model.antennas)
    description = model.describe()
    if sheet is not None:
        surroundings = replace(model.surroundings, sheets=(sheet,))
        h = h + sheet_echo(sheet, surroundings, model.chirp, model.antennas, model.numerics.tolerance)
        description["surroundings"] = surroundings.describe(model.chirp.center_hz)
    return IdealEcho(h.astype(np.complex64), model.antennas, description, time.perf_counter() - started)


def echo_of_clean(scan: Measurement) -> IdealEcho:
    """The echo that a recorded clean scan consists of."""
    description = {name: scan.metadata[name] for name in ("targets", "surroundings", "numerics")}
    return IdealEcho(scan.h, scan.aperture, description, scan.metadata["seconds"])


def record(
    scene: TwinScene, echo: IdealEcho, condition: Condition, settings: TwinSettings, origin: Mapping[str, Any]
) -> Measurement:
    """What the radar records of an echo under one of its conditions.

    Args:
        scene: the object.
        echo: of `ideal_echo`, for this condition or one with the same `echo_key`.
        condition: gives the front end.
        settings: of the twin.
        origin: JSON values added to the metadata.
    """
    front_end, seed = condition.front_end, settings.front_end_seed(scene.item.object_id)
    h = echo.h
    if not front_end.is_ideal:
        h = apply_front_end(front_end, h, 0, echo.antennas, settings.chirp, seed)
    source = {"unit_m": 1.0, "fix_winding": False, "pose": scene.pose.tolist()}
    metadata = {
        **echo.description,
        "front_end": front_end.describe(),
        "seed": seed,
        "seconds": echo.seconds,
        "meshes": [{**scene.describe()["mesh"], **source}],
        **origin,
    }
    return Measurement(h, settings.chirp, settings.aperture, front_end.range_bias_m, metadata)


def group_by_echo(conditions: Sequence[Condition]) -> list[list[Condition]]:
    """Conditions with the same echo together, in the order given."""
    groups: dict[Any, list[Condition]] = {}
    for condition in conditions:
        groups.setdefault(condition.echo_key, []).append(condition)
    return list(groups.values())


def _check_below(scene: TwinScene, lower_face_m: float) -> None:
    top_m = float(scene.bounds_m[1, 2])
    if top_m >= lower_face_m:
        raise MeshError(
            "mesh.through_sheet",
            f"{scene.item.object_id}: its top at z = {top_m:.3f} m reaches through the sheet, whose lower face lies at "
            f"{lower_face_m:.3f} m: leave it out, or use a condition without sheet",
        )
