"""Order of the 16-bit numbers in recordings of TI's capture card DCA1000 (TI application report SWRA581).

Complex samples, int16, little-endian, chirp after chirp. With two LVDS lanes (xWR16xx, xWR18xx, xWR68xx) the receivers
of a chirp follow each other, and pairs of samples are stored I0 I1 Q0 Q1. With four lanes (xWR12xx, xWR14xx) every
sample is stored as I of the four receivers, then Q of the four; lanes without a receiver hold zeros.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError

LVDS_LANES = {"xwr12xx": 4, "xwr14xx": 4, "xwr16xx": 2, "xwr18xx": 2, "xwr68xx": 2}
_WORD = np.dtype("<i2")
# Two lanes carry one, two or four receivers, never three.
_RECEIVERS = {2: (1, 2, 4), 4: (1, 2, 3, 4)}


def to_dca1000(i: NDArray[np.int16], q: NDArray[np.int16], device: str) -> bytes:
    """Content of a recording.

    Args:
        i, q: real and imaginary parts, shape (chirps, receivers, ADC samples).
        device: a key of `LVDS_LANES`.

    Raises:
        RadarError: the device is unknown, or its recordings do not have this shape.
    """
    if i.ndim != 3 or i.shape != q.shape:
        raise RadarError(f"i and q must be (chirps, receivers, ADC samples), got {i.shape} and {q.shape}")
    lanes = _checked_lanes(device, i.shape[1], i.shape[2])
    chirps, receivers, samples = i.shape
    if lanes == 2:
        pairs = (chirps, receivers, samples // 2, 2)
        words = np.stack([i.reshape(pairs), q.reshape(pairs)], axis=3)
    else:
        words = np.zeros((chirps, samples, 2, lanes), dtype=np.int16)
        words[:, :, 0, :receivers] = i.transpose(0, 2, 1)
        words[:, :, 1, :receivers] = q.transpose(0, 2, 1)
    return words.astype(_WORD).tobytes()


def from_dca1000(
    content: bytes, device: str, num_receivers: int, num_samples: int
) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Real and imaginary parts of a recording, each (chirps, receivers, ADC samples).

    Raises:
        RadarError: the device is unknown, or the content is no whole number of chirps.
    """
    lanes = _checked_lanes(device, num_receivers, num_samples)
    stored = num_receivers if lanes == 2 else lanes
    chirp_bytes = 2 * _WORD.itemsize * stored * num_samples
    if len(content) % chirp_bytes:
        raise RadarError(f"{len(content)} bytes are no whole number of chirps of {chirp_bytes} bytes")
    words: NDArray[Any] = np.frombuffer(content, dtype=_WORD).astype(np.int16)
    if lanes == 2:
        pairs = words.reshape(-1, num_receivers, num_samples // 2, 2, 2)
        i, q = (pairs[..., part, :].reshape(-1, num_receivers, num_samples) for part in (0, 1))
        return i, q
    by_lane = words.reshape(-1, num_samples, 2, lanes)[..., :num_receivers]
    i, q = (by_lane[:, :, part].transpose(0, 2, 1) for part in (0, 1))
    return i, q


def _checked_lanes(device: str, receivers: int, samples: int) -> int:
    if device not in LVDS_LANES:
        raise RadarError(f"unknown device {device!r}: choose one of {', '.join(LVDS_LANES)}")
    lanes = LVDS_LANES[device]
    if receivers not in _RECEIVERS[lanes]:
        raise RadarError(f"{device} records {_RECEIVERS[lanes]} receivers, not {receivers}")
    if lanes == 2 and samples % 2:
        raise RadarError(f"{device} stores samples in pairs, but a chirp has {samples}")
    return lanes
