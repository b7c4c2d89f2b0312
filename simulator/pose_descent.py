"""Levenberg-Marquardt over a pose, on whatever a residual compares."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.rigid_pose import RigidPose

# Steps count in units of a millimetre, and of the turn that moves a point 7 cm off the middle by one.
_UNITS = np.array(3 * [1e-3] + 3 * [1e-3 / 0.07])
_LONGEST_STEP, _SETTLED_STEP, _SETTLED_GAIN = 4.0, 0.2, 1e-3
_FIRST_DAMPING, _ATTEMPTS = 1e-2, 4

Linearised = Callable[[RigidPose], tuple[NDArray[Any], NDArray[Any]]]


class Comparison(Protocol):
    """Residual of a signal against a measured one."""

    def linearise(self, signal: NDArray[Any], columns: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Residual (K,) and its derivatives (K, D) for a signal (N, M) with derivatives (N, M, D)."""
        ...


class FreeGains:
    """The complex signal, but for one complex gain of every group of antennas.

    Phase and level of a group are projected out (variable projection, Golub & Pereyra 1973, in Kaufman's
    approximation); what is left are the slopes of the wavefront inside it.

    Args:
        measured: signal (N, M).
        groups: group of every antenna, shape (N,); None compares the signal as it is.
    """

    def __init__(self, measured: NDArray[Any], groups: NDArray[np.int64] | None) -> None:
        self._measured, self._groups = measured.astype(np.complex128), groups
        self._norm = float(np.linalg.norm(measured))

    def linearise(
        self, signal: NDArray[Any], columns: NDArray[Any]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See `Comparison`."""
        signal, columns = signal.astype(np.complex128), columns.astype(np.complex128)
        if self._groups is not None:
            power = self._sums((np.abs(signal) ** 2).sum(axis=1)) + 1e-30
            gains = self._sums((signal.conj() * self._measured).sum(axis=1)) / power
            share = self._sums((signal.conj()[..., None] * columns).sum(axis=1)) / power[:, None]
            columns = gains[:, None, None] * (columns - share[:, None, :] * signal[..., None])
            signal = gains[:, None] * signal
        residual = ((signal - self._measured) / self._norm).ravel()
        slopes = (columns / self._norm).reshape(len(residual), -1)
        return (
            np.concatenate([residual.real, residual.imag]),
            np.concatenate([slopes.real, slopes.imag]),
        )

    def _sums(self, values: NDArray[Any]) -> NDArray[Any]:
        """Sum over the group of every antenna."""
        assert self._groups is not None
        sums = np.zeros((int(self._groups.max()) + 1, *values.shape[1:]), dtype=values.dtype)
        np.add.at(sums, self._groups, values)
        return np.asarray(sums[self._groups])


def descend(linearised: Linearised, start: RigidPose, max_steps: int) -> tuple[RigidPose, float]:
    """Pose at the end of the valley that `start` lies in, and the squared residual there.

    Args:
        linearised: residual (K,) and its derivatives (K, 6) by the arguments of `RigidPose.moved`.
        start: the first pose.
        max_steps: accepted steps at most.
    """

    def equations(pose: RigidPose) -> tuple[NDArray[Any], NDArray[Any], float]:
        residual, slopes = linearised(pose)
        slopes = slopes * _UNITS
        return slopes.T @ slopes, -slopes.T @ residual, float(residual @ residual)

    pose, damping = start, _FIRST_DAMPING
    normal, slope, misfit = equations(pose)
    for _ in range(max_steps):
        for _ in range(_ATTEMPTS):
            damped = normal + damping * np.diag(np.diag(normal)) + 1e-9 * np.trace(normal) * np.eye(6)
            step = np.linalg.solve(damped, slope)
            longest = float(np.abs(step).max())
            step *= min(1.0, _LONGEST_STEP / longest) if longest > 0 else 1.0
            trial = pose.moved(step * _UNITS)
            trial_normal, trial_slope, trial_misfit = equations(trial)
            if trial_misfit < misfit:
                break
            damping = max(6.0 * damping, 1e-3)
        else:
            break
        gain = misfit - trial_misfit
        pose, normal, slope, misfit = trial, trial_normal, trial_slope, trial_misfit
        damping /= 4.0
        if gain < _SETTLED_GAIN * misfit and longest < _SETTLED_STEP:
            break
    return pose, misfit
