"""Receiver arrays: one transmitter with several receivers beside it, as rows of an aperture."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture

_MITO_WAVELENGTH_M = SPEED_OF_LIGHT_M_PER_S / 77.5001e9


def _mito_row(axis: int) -> tuple[tuple[float, float, float], ...]:
    """RX0 .. RX3 of MITO: -5 mm - k lambda / 2 along one axis, k = 3 .. 0, from the transmitter."""
    offsets = np.zeros((4, 3))
    offsets[:, axis] = -0.005 - np.arange(3, -1, -1) * _MITO_WAVELENGTH_M / 2
    return tuple((float(x), float(y), float(z)) for x, y, z in offsets)


# Receiver minus transmitter, in metres.
RECEIVER_PRESETS: dict[str, tuple[tuple[float, float, float], ...]] = {
    # MITO and mmNorm: TX1 and the four receivers of the IWR1443BOOST, row along x ("rx offset" = "x").
    "mito": _mito_row(0),
    # The same board turned by 90 degrees ("rx offset" = "y").
    "mito_y": _mito_row(1),
}


def with_receivers(aperture: Aperture, offsets_m: str | ArrayLike) -> Aperture:
    """Every transmitter position with every receiver: row = position * R + receiver.

    Args:
        aperture: monostatic, N positions of the transmitter.
        offsets_m: receiver minus transmitter, shape (R, 3), or the name of a preset of `RECEIVER_PRESETS`.

    Returns:
        Aperture of N * R pairs.

    Raises:
        RadarError: the aperture already has receivers, the name is unknown, or the shape is not (R, 3).
    """
    if not aperture.is_monostatic:
        raise RadarError(
            "with_receivers needs an aperture of transmitter positions only, this one has receivers"
        )
    offsets = _offsets(offsets_m)
    tx = np.repeat(aperture.tx_m, len(offsets), axis=0)
    return Aperture(tx, tx + np.tile(offsets, (len(aperture), 1)))


def _offsets(offsets_m: str | ArrayLike) -> NDArray[np.float64]:
    if isinstance(offsets_m, str):
        if offsets_m not in RECEIVER_PRESETS:
            raise RadarError(f"unknown receiver preset {offsets_m!r}; known: {', '.join(RECEIVER_PRESETS)}")
        return np.array(RECEIVER_PRESETS[offsets_m])
    try:
        offsets = np.array(offsets_m, dtype=np.float64)
    except (TypeError, ValueError):
        offsets = np.empty(0)
    if offsets.ndim != 2 or offsets.shape[1:] != (3,) or len(offsets) == 0 or not np.isfinite(offsets).all():
        raise RadarError(f"receiver offsets_m must be finite metres of shape (R, 3), got {offsets_m!r}")
    return offsets
