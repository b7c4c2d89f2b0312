"""A sheet's own echo: the antenna's mirror image in its face, weakened by the slab's reflection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.plane_image import heights_over, way_by_plane
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference_response import pair_response
from waveformer.simulator.response_plan import plan_response
from waveformer.simulator.surroundings import Surroundings


def sheet_echo(
    sheet: Sheet, surroundings: Surroundings, chirp: Chirp, aperture: Aperture, tolerance: float
) -> NDArray[np.complex128]:
    """Echo of an infinite sheet, h = r lambda / (4 pi L) exp(-j k L), L the path by way of its face.

    Exact for an infinite mirror, for pairs, too; r is the plane wave's at the angle of reflection. Other sheets
    and the box weaken it; objects in front of it do not shadow it.

    Args:
        sheet: one of the surroundings' sheets.
        surroundings: antennas and occluders.
        chirp, aperture: the radar, T samples and N pairs.
        tolerance: of the interpolation over the band.

    Returns:
        Shape (N, T).

    Raises:
        RadarError: antennas lie on both sides of the sheet.
    """
    normal, point = np.asarray(sheet.normal), np.asarray(sheet.point_m)
    tx, rx = aperture.tx_m, aperture.receivers_m
    if not (heights_over(tx, point, normal) * heights_over(rx, point, normal) > 0).all():
        raise RadarError("a sheet with an echo must have transmitter and receiver on one side of it")
    length, mirror_point = way_by_plane(tx, rx, point, normal)
    others = replace(surroundings, sheets=tuple(s for s in surroundings.sheets if s is not sheet))
    bounds = np.array([mirror_point.min(axis=0), mirror_point.max(axis=0)])
    plan = plan_response(sheet.material, others, "any", chirp, tolerance, bounds, np.concatenate([tx, rx]))
    weights = [pair_response(plan, float(f), mirror_point, normal, tx, rx) for f in plan.frequencies_hz]
    response = np.stack(weights, axis=1) @ plan.to_samples
    phase = np.exp(-2j * np.pi * chirp.frequencies_hz * (length / SPEED_OF_LIGHT_M_PER_S)[:, None])
    spreading = chirp.wavelengths_m / (4.0 * np.pi) / length[:, None]
    return np.asarray(response * phase * spreading)
