"""From meshes to the raw signal H: the pipeline on one screen."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.forward_model import BLOCK_POSITIONS, ForwardModel, Progress
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.radar import Aperture, Chirp


def simulate(
    targets: Any,
    chirp: Chirp,
    aperture: Aperture,
    *,
    sheets: Sequence[Sheet] = (),
    box: Box | None = None,
    antenna: Antenna | None = None,
    polarization: Sequence[float] | NDArray[np.float64] = (0.0, 1.0, 0.0),
    front_end: FrontEnd | None = None,
    mode: str | Numerics = "fast",
    tile_positions: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Measurement:
    """Raw FMCW signal of a scene by physical optics with ray-traced visibility, single bounce.

    h(f) = (j / 4 pi) sum sqrt(G_tx G_rx) Gamma V (cos_i + cos_r) / 2 dA / (R_tx R_rx) exp(-j k (R_tx + R_rx)),
    calibrated: ``|h|^2`` is received over transmitted power. Each way is weakened and delayed by the sheets and
    walls that it crosses. Multiple bounces, edge diffraction beyond physical optics and the echo of the back of a
    dielectric body are left out.

    Args:
        targets: a mesh (trimesh.Trimesh or path), a Target, or a sequence of them, in metres in the radar
            frame (z up, the aperture looks down); or a Mitsuba scene, as a dictionary or the path of an XML file,
            which may bring sheets and a box of its own (`scene_file.load_scene`).
        chirp: T samples.
        aperture: N pairs of antennas.
        sheets: infinite flat occluders.
        box: a closed box around the targets; its walls weaken every echo and send back their own.
        antenna: gain of both antennas; None means isotropic with 0 dBi.
        polarization: direction of E at both antennas, shape (3,); it matters for sheets, boxes and dielectrics.
        front_end: what the radar does to the ideal signal; None leaves it ideal.
        mode: "fast" (factorised kernel), "exact" (every pair, visibility per position) or a Numerics.
        tile_positions: most positions in flight at once; bounds memory, changes the result by rounding only.
        seed: of all that the front end draws at random.
        progress: called with (positions done, positions in all).

    Returns:
        Measurement with h of shape (N, T).

    Raises:
        MeshError: a mesh cannot be used, touches or lies behind the aperture, or reaches through the box.
        RadarError: the scene exceeds the unambiguous range, or the settings make no sense.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    started = time.perf_counter()
    model = ForwardModel.prepare(
        targets, chirp, aperture, sheets=sheets, box=box, antenna=antenna, polarization=polarization,
        front_end=front_end, mode=mode, tile_positions=tile_positions, seed=seed,
    )  # fmt: skip
    h = np.empty((len(aperture), chirp.num_samples), dtype=np.complex64)
    reference_power = model.reference_power()
    for first in range(0, len(aperture), BLOCK_POSITIONS):
        rows = slice(first, min(first + BLOCK_POSITIONS, len(aperture)))
        h[rows] = model.record(rows, reference_power, _offset(progress, first, len(aperture)))
    if progress is not None:
        progress(len(aperture), len(aperture))
    metadata = {**model.describe(), "seconds": time.perf_counter() - started}
    return Measurement(h, chirp, aperture, model.front_end.range_bias_m, metadata)


def _offset(progress: Progress | None, first: int, total: int) -> Progress | None:
    """Progress of a block of rows as progress of all rows."""
    if progress is None:
        return None
    return lambda done, _: progress(first + done, total)
