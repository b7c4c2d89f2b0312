"""Which antennas take part in the choice of a level: those that see one clear echo (mmNorm)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# mmNorm: least peak re the strongest antenna, tried in turn until enough antennas are left.
_LEAST_PEAKS = (0.5, 0.1, 0.05)
_ENOUGH = 20
_MOST_MEAN_TO_PEAK = 0.7


class AntennaChoice(NamedTuple):
    """Antennas that take part.

    Attributes:
        rows: rows of the measurement, ascending, shape (n,); empty if there is no signal.
        note: empty if enough antennas passed at the first threshold, else what was done instead.
    """

    rows: NDArray[np.int64]
    note: str


def choose_antennas(magnitude: NDArray[np.floating], count: int, rng: np.random.Generator) -> AntennaChoice:
    """Draw antennas whose echo in the window is strong, peaky, and not strongest at an end of the window.

    Passing means peak > 0.5 of the strongest antenna's peak and mean < 0.7 peak; with fewer than 20 left the 0.5
    becomes 0.1, then 0.05 (mmNorm). If still none passes, the antennas of strongest peak are taken.

    Args:
        magnitude: range profiles in the window, shape (N, W).
        count: at most so many antennas.
        rng: its state decides which.
    """
    peak = magnitude.max(axis=1)
    if not peak.max() > 0:
        return AntennaChoice(np.empty(0, dtype=np.int64), "the signal is zero in the range of the candidates")
    position = magnitude.argmax(axis=1)
    clear = (position > 0) & (position < magnitude.shape[1] - 1)
    clear &= magnitude.mean(axis=1) < _MOST_MEAN_TO_PEAK * peak
    passing = np.empty(0, dtype=np.int64)
    for least in _LEAST_PEAKS:
        passing = np.flatnonzero(clear & (peak > least * peak.max()))
        if len(passing) >= _ENOUGH:
            break
    if len(passing) == 0:
        strongest = np.argsort(-peak, kind="stable")[:count]
        note = f"no antenna has a clear echo inside the window: the {len(strongest)} strongest were taken"
        return AntennaChoice(np.sort(strongest[peak[strongest] > 0]), note)
    note = "" if least == _LEAST_PEAKS[0] else f"{len(passing)} antennas passed only at {least:g} of the peak"
    if len(passing) > count:
        passing = np.sort(rng.choice(passing, size=count, replace=False))
    return AntennaChoice(passing, note)
