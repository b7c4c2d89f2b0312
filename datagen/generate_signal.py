"""The signal H of one sample: the object's echo, that of a sheet in front of it, and the front end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.generate_draws import SampleSeed, draw_front_end, draw_material, draw_sheet
from waveformer.datagen.generate_settings import SignalSettings
from waveformer.simulator.forward_model import ForwardModel
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.sheet_echo import sheet_echo
from waveformer.simulator.target import Target


def make_signal(
    mesh: SurfaceMesh, aperture: Aperture, settings: SignalSettings, seed: SampleSeed
) -> tuple[NDArray[np.complex64], dict[str, Any]]:
    """Draw what the radar meets, and simulate it.

    Args:
        mesh: the object in the radar frame.
        aperture: N positions.
        settings: chirp of T samples, and ranges.
        seed: of the sample.

    Returns:
        H, shape (N, T); and the draws as JSON values.

    Raises:
        MeshError, RadarError, SetupError: as `simulate`.
    """
    chirp = Chirp(**settings.chirp.model_dump())
    material, reflectivity = draw_material(settings.material, seed.generator("material"))
    sheet = draw_sheet(settings.occluder, float(mesh.vertices_m[:, 2].max()), seed.generator("occluder"))
    front_end = draw_front_end(settings.front_end, seed.generator("front end"))
    front_end_seed = seed.integer("front end seed")
    model = ForwardModel.prepare(
        Target(mesh, material),
        chirp,
        aperture,
        sheets=() if sheet is None else (replace(sheet, echo=False),),
        front_end=front_end,
        mode=settings.mode,
        seed=front_end_seed,
    )
    h = np.float32(reflectivity) * model.echo(model.antennas)
    if sheet is not None and sheet.echo:  # weakened by nothing of the object's
        surroundings = replace(model.surroundings, sheets=(sheet,))
        h = h + sheet_echo(sheet, surroundings, chirp, model.antennas, model.numerics.tolerance)
    h = apply_front_end(front_end, h.astype(np.complex64), 0, model.antennas, chirp, front_end_seed)
    described = {
        "material": material.describe(chirp.center_hz),
        "reflectivity": reflectivity,
        "sheet": None if sheet is None else sheet.describe(chirp.center_hz),
        "front_end": front_end.describe(),
        "front_end_seed": front_end_seed,
        "range_bias_m": front_end.range_bias_m,
        "mode": settings.mode,
    }
    return h, described
