"""The last steps of a pose by the differentiable model: all frequencies, visibility from every part of the aperture."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from waveformer.simulator.differentiable import freeze, rotation_matrix, simulate
from waveformer.simulator.least_squares import Stage, fit
from waveformer.simulator.numerics import FAST
from waveformer.simulator.pose_body import Body
from waveformer.simulator.radar import Chirp
from waveformer.simulator.rigid_pose import RigidPose

# Half a wavelength with the form factor is good to a few per cent of the signal, which move a pose by micrometres;
# the derivatives only choose the step, so they take the tolerance of the fast mode.
_NUMERICS = FAST.model_copy(update={"spacing_wavelengths": 0.5})
# One step from a tenth of a millimetre lands within micrometres, and no shadow moves: such a round is the last.
_MAX_ROUNDS, _SETTLED_M, _SETTLED_DEG = 2, 1e-4, 0.05
_SCALES = torch.tensor(3 * [1e-3] + 3 * [1e-2], dtype=torch.float64)


def refine(
    body: Body, pose: RigidPose, h: NDArray[Any], chirp: Chirp, tx_m: NDArray[np.float64]
) -> tuple[RigidPose, float]:
    """Pose at the coherent minimum near `pose`, and the misfit there; visibility is traced anew for every round.

    Args:
        body: the object.
        pose: within an eighth of a wavelength of the minimum.
        h: measured signal (N, T).
        chirp: T samples.
        tx_m: monostatic antennas (N, 3).
    """
    measured = torch.tensor(np.asarray(h, dtype=np.complex64))
    misfit = np.inf
    for _ in range(_MAX_ROUNDS):
        offsets = (body.mesh.vertices_m - body.middle_m) @ pose.rotation.T
        frozen = freeze(offsets + pose.center_m, body.mesh.faces, chirp, tx_m, mode=_NUMERICS)
        around, center = torch.from_numpy(offsets), torch.from_numpy(pose.center_m.copy())

        def model(
            motion: torch.Tensor,
            around: torch.Tensor = around,
            center: torch.Tensor = center,
            frozen: Any = frozen,
        ) -> torch.Tensor:
            vertices = around @ rotation_matrix(motion[3:]).T + center + motion[:3]
            return simulate(vertices, body.mesh.faces, chirp, tx_m, frozen=frozen)

        found = fit(model, measured, torch.zeros(6, dtype=torch.float64), _SCALES, [Stage(max_iterations=1)])
        last, misfit = pose, found.misfit
        pose = last.moved(found.values.numpy())
        shift_m, turn_deg = pose.apart(last)
        if shift_m < _SETTLED_M and turn_deg < _SETTLED_DEG:
            break
    return pose, misfit
