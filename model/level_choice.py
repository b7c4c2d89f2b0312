"""Loss of candidate levels against the measured profile, and the choice among them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from waveformer.model.phase_agreement import profile_correlation

Loss = Literal["complex", "magnitude"]
# Share of a profile's power, -30 dB, that even the true surface leaves unexplained: candidates are smooth sheets between
# voxels, summed without shadows. From 1e-5 to 1e-2 it chooses the same levels.
_UNEXPLAINED = 1e-3
# mmNorm's limits on heights and prominences are sums over this many antennas.
_MMNORM_ANTENNAS = 50
_MAX_SWEEPS = 50


def antenna_losses(
    measured: NDArray[Any], simulated: NDArray[Any], loss: Loss = "complex"
) -> NDArray[np.float64]:
    """How badly every level explains the profile of every antenna.

    Args:
        measured: complex profiles, shape (n, W).
        simulated: of every level, complex amplitudes, or with "magnitude" also real powers, shape (L, n, W).
        loss: "complex", see `residual_losses`; or "magnitude", mmNorm's, which knows no phase: the magnitudes in the window,
            each side of unit L2 norm, and the sum of their differences, 0 .. sqrt(2 W).

    Returns:
        Shape (L, n); a level without an echo explains nothing.
    """
    if loss == "complex":
        return residual_losses(profile_correlation(measured, simulated))
    return np.asarray(np.abs(_unit(np.abs(measured)) - _unit(_magnitude(simulated))).sum(axis=-1))


def residual_losses(correlation: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Log of the power that a surface leaves unexplained, 0 (none) .. 1 (all), from correlations of any shape.

    Let the profile of an antenna be m = a s + e, with a complex factor a of its own (material, pattern, phase, row error)
    and a rest e of its own power. The best a leaves the share 1 - |c|^2 of the power, and the likelihood of the
    level is the product of these shares over antennas (to the power -W). A range bin is ten wavelengths wide: within
    it only the phase across bins tells where the echo lies, so magnitudes alone waste most of what a profile knows.
    """
    left = np.maximum(1.0 - np.abs(correlation) ** 2, 0.0)
    return np.asarray(np.log1p(left / _UNEXPLAINED) / np.log1p(1.0 / _UNEXPLAINED))


def coordinate_descent(
    measured: NDArray[Any], responses: Sequence[NDArray[Any]], loss: Loss = "complex"
) -> list[int]:
    """Levels of several components whose echoes add, such that no single change of one lowers the loss.

    It starts with the first component alone, adds the others one by one at their best level, then goes round
    until nothing changes.

    Args:
        measured: complex profiles, shape (n, W).
        responses: of every component, (L_c, n, W), L_c >= 1, the largest component first.
        loss: as `antenna_losses`.

    Returns:
        One level a component.
    """
    chosen: list[int] = []
    for index in range(len(responses)):
        slice_ = component_losses(measured, responses[: index + 1], [*chosen, 0], index, loss).sum(axis=1)
        chosen.append(int(np.argmin(slice_)))
    for _ in range(_MAX_SWEEPS):
        before = list(chosen)
        for index in range(len(responses)):
            slice_ = component_losses(measured, responses, chosen, index, loss).sum(axis=1)
            best = int(np.argmin(slice_))
            if slice_[best] < slice_[chosen[index]]:
                chosen[index] = best
        if chosen == before:
            break
    return chosen


def component_losses(
    measured: NDArray[Any],
    responses: Sequence[NDArray[Any]],
    chosen: Sequence[int],
    index: int,
    loss: Loss = "complex",
) -> NDArray[np.float64]:
    """Loss of every level of one component, the others held at their chosen levels, shape (L_c, n)."""
    return antenna_losses(measured, added_responses(responses, chosen, index), loss)


def added_responses(responses: Sequence[NDArray[Any]], chosen: Sequence[int], index: int) -> NDArray[Any]:
    """Response of every level of one component together with the others at their chosen levels, (L_c, n, W)."""
    total = responses[index]
    for other, response in enumerate(responses):
        if other != index:
            total = total + response[chosen[other]]
    return total


def last_peak(loss: NDArray[np.float64], num_antennas: int, several: bool) -> int:
    """Choice of mmNorm: the highest level among the clear minima of the loss, the one closest to the radar.

    Minima are peaks of max - loss that scipy's find_peaks accepts. One component: height at least 0.9 of the
    highest (0.3 if that is at an end), prominence at least 1, and the global minimum itself if it is not at an
    end. Several components, along one of them: height at least 0.4 of the highest and 2, prominence 0.1. The
    absolute limits are meant for 50 antennas and are scaled to the number used.

    Args:
        loss: summed over antennas, levels ascending, shape (L,).
        num_antennas: summed over.
        several: whether the loss is a slice through the levels of several components.

    Returns:
        The level; the global minimum if there is no such peak.
    """
    from scipy.signal import find_peaks

    gain = loss.max() - loss
    best = int(np.argmin(loss))
    is_inside = 0 < best < len(loss) - 1
    scale = num_antennas / _MMNORM_ANTENNAS
    if several:
        height, prominence = max(0.4 * gain[best], 2.0 * scale), 0.1 * scale
    else:
        height, prominence = (0.9 if is_inside else 0.3) * gain[best], scale
    peaks = [int(peak) for peak in find_peaks(gain, height=height, prominence=prominence)[0]]
    if is_inside and not several:
        peaks.append(best)
    return max(peaks) if peaks else best


def _magnitude(values: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(np.abs(values) if np.iscomplexobj(values) else np.sqrt(values))


def _unit(values: NDArray[Any]) -> NDArray[Any]:
    # einsum: one pass without a squared copy; in double, because squares of weak echoes underflow
    norm = np.sqrt(np.einsum("...w,...w->...", values, values, dtype=np.float64))[..., None]
    return np.asarray(values / np.where(norm > 0, norm, 1.0))
