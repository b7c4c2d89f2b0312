"""The methods of the table, from one proposal: what each one calls the object's surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.eval.baselines import backprojection_cloud, extrude_to_support, mirror
from waveformer.model.proposal import Proposal
from waveformer.model.voxels import voxel_positions_m
from waveformer.simulator.errors import RadarError

# Points of a completion, as many as the ground truth has.
_COMPLETED_POINTS = 16384


class MethodInput(NamedTuple):
    """What methods may use.

    Attributes:
        proposal: candidate surfaces and the choice.
        mmnorm: the same candidates chosen by mmNorm's loss, which compares magnitudes.
        support_z_m: height of the plane on which the object rests.
        rng: for completions that draw points.
    """

    proposal: Proposal
    mmnorm: Proposal
    support_z_m: float
    rng: np.random.Generator


Method = Callable[[MethodInput], NDArray[np.float64]]


def _backprojection(share: float) -> Method:
    def cloud(given: MethodInput) -> NDArray[np.float64]:
        focused = given.proposal.focus
        return (
            np.empty((0, 3)) if focused is None else backprojection_cloud(focused.image, focused.grid, share)
        )

    return cloud


def _li(given: MethodInput) -> NDArray[np.float64]:
    focused, mask = given.proposal.focus, given.proposal.mask
    if focused is None or mask is None:
        return np.empty((0, 3))
    return voxel_positions_m(focused.grid, np.argwhere(mask.mask))


def _extruded(given: MethodInput) -> NDArray[np.float64]:
    partial = given.proposal.surface_m()
    if len(partial) == 0:
        return partial
    return extrude_to_support(partial, given.support_z_m, _COMPLETED_POINTS, given.rng).points_m


def _mirrored(given: MethodInput) -> NDArray[np.float64]:
    partial = given.proposal.surface_m()
    if len(partial) == 0:
        return partial
    return mirror(partial, given.support_z_m, _COMPLETED_POINTS, given.rng).points_m


# backprojection: voxels above a share of max |S|; proposal: the chosen level as sub-voxel points; mmnorm: the one that
# mmNorm's loss chooses; mmnorm_voxels: as voxels, as the original gives it; extruded and mirrored: shape-free completions
# of the proposal that every learner must beat.
METHODS: dict[str, Method] = {
    "backprojection": _backprojection(0.4),
    "backprojection_0.3": _backprojection(0.3),
    "backprojection_li": _li,
    "proposal": lambda given: given.proposal.surface_m(),
    "mmnorm": lambda given: given.mmnorm.surface_m(),
    "mmnorm_voxels": lambda given: given.mmnorm.voxels_m(),
    "extruded": _extruded,
    "mirrored": _mirrored,
}


def require_methods(names: list[str]) -> list[str]:
    """The names, if all are known.

    Raises:
        RadarError: a method is unknown.
    """
    for name in names:
        if name not in METHODS:
            raise RadarError(f"unknown method {name!r}; known: {', '.join(METHODS)}")
    return names
