"""Where a known object is: its pose from a measured signal, coarse to fine.

The misfit of a signal has a minimum every half wavelength and every tenth of a degree, and gradients lead into the
nearest one. So a population searches first on what does not turn with the wavelength (`aperture_power`); then steps
follow slopes inside tiles of the aperture, each with a free complex gain; then the whole signal with its phase; and at
last the differentiable model with its visibility. A search can settle in a wrong valley that looks nearly as good:
independent ones are made until the best two agree.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.arguments import real_number
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.pose_stages import ACCEPTED_MISFIT, PoseStages, Reached
from waveformer.simulator.radar import Chirp

_MAX_RUNS, _AGREE_M, _AGREE_DEG = 8, 1e-3, 0.3

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class PoseStep:
    """A pose on the way.

    Attributes:
        stage: what led there.
        pose: shape (4, 4).
        misfit: squared residual of that stage over the measured square; stages compare different things.
    """

    stage: str
    pose: NDArray[np.float64]
    misfit: float


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A recovered pose.

    Attributes:
        pose: takes mesh coordinates to the radar frame, shape (4, 4).
        misfit: power of what the model leaves over power of the signal: that of the noise where all is well, both
            per sample and not per range bin.
        agreed: whether two independent searches led to this pose; if not, do not trust it.
        runs: searches made.
        seconds: wall clock.
        history: the best search, and what followed.
    """

    pose: NDArray[np.float64]
    misfit: float
    agreed: bool
    runs: int
    seconds: float
    history: tuple[PoseStep, ...]


def recover_pose(
    h: ArrayLike,
    mesh_vertices: ArrayLike,
    faces: ArrayLike,
    chirp: Chirp,
    tx_m: ArrayLike,
    start_pose: ArrayLike,
    *,
    seed: int,
    search_m: float = 0.003,
    search_deg: float = 3.0,
    progress: Progress | None = None,
) -> PoseFit:
    """Pose of a known, conducting, asymmetric object in free space from a calibrated monostatic scan.

    Args:
        h: raw signal (N, T).
        mesh_vertices: (V, 3), metres.
        faces: (F, 3).
        chirp: T samples, at least 4.
        tx_m: positions (N, 3): a regular grid in a plane of constant z, in any order.
        start_pose: first guess (4, 4); some 5 mm and 5 degrees off are found with the default search.
        seed: of the search.
        search_m, search_deg: standard deviations of the start pose along and about every axis.
        progress: called with one line after every stage.

    Raises:
        MeshError: the mesh or the pose cannot be used, or the object touches or lies behind the aperture.
        RadarError: shapes do not fit, the positions are no regular grid of at least 8 x 8, the object lies beyond the
            unambiguous range, or numbers make no sense.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    started = time.perf_counter()
    stages = PoseStages.of(h, mesh_vertices, faces, chirp, tx_m, start_pose)
    shift_m, turn_deg = real_number("search_m", search_m), real_number("search_deg", search_deg)
    if not (shift_m > 0 and turn_deg > 0):
        raise RadarError(f"search_m and search_deg must be positive, got {shift_m:g} and {turn_deg:g}")
    deviations = np.array(3 * [shift_m] + 3 * [np.radians(turn_deg)])
    tell = progress or (lambda line: None)
    runs: list[list[Reached]] = []
    agreed = False
    while len(runs) < _MAX_RUNS and not agreed:
        runs.append(stages.run(deviations, generator(seed, "pose search", len(runs))))
        tell(f"search {len(runs)}: misfit {runs[-1][-1].misfit:.4f}")
        runs.sort(key=lambda run: run[-1].misfit)
        agreed = len(runs) > 1 and runs[0][-1].misfit < ACCEPTED_MISFIT and _agree(runs[0], runs[1])
    reached = [*runs[0], stages.with_phase(runs[0][-1].pose)]
    tell(f"with phase: misfit {reached[-1].misfit:.4f}")
    reached.append(stages.refined(reached[-1].pose))
    tell(f"refined: misfit {reached[-1].misfit:.4f}")
    history = tuple(PoseStep(at.stage, at.pose.matrix(stages.middle_m), at.misfit) for at in reached)
    seconds = time.perf_counter() - started
    return PoseFit(history[-1].pose, history[-1].misfit, agreed, len(runs), seconds, history)


def _agree(first: list[Reached], second: list[Reached]) -> bool:
    shift_m, turn_deg = first[-1].pose.apart(second[-1].pose)
    return shift_m < _AGREE_M and turn_deg < _AGREE_DEG
