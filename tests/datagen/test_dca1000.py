"""Recordings of the capture card: every number in its place, and back."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.datagen.dca1000 import LVDS_LANES, from_dca1000, to_dca1000
from waveformer.simulator.errors import RadarError


def numbered(chirps, receivers, samples):
    """Real parts 1, 2, 3, ...; imaginary parts the same, negative."""
    i = np.arange(1, chirps * receivers * samples + 1, dtype=np.int16).reshape(chirps, receivers, samples)
    return i, -i


def test_two_lanes_by_hand():
    # I0 I1 Q0 Q1, receiver after receiver inside a chirp
    words = np.frombuffer(to_dca1000(*numbered(2, 2, 4), "xwr18xx"), dtype="<i2")
    first_chirp = [1, 2, -1, -2, 3, 4, -3, -4] + [5, 6, -5, -6, 7, 8, -7, -8]
    assert words[:16].tolist() == first_chirp
    assert words[16:20].tolist() == [9, 10, -9, -10]


def test_four_lanes_by_hand():
    # sample after sample: I of all four lanes, Q of all four; the fourth lane has no receiver
    words = np.frombuffer(to_dca1000(*numbered(1, 3, 2), "xwr14xx"), dtype="<i2")
    assert words.tolist() == [1, 3, 5, 0, -1, -3, -5, 0, 2, 4, 6, 0, -2, -4, -6, 0]


def test_two_lanes_as_a_plain_loop_reads_them(rng):
    """An obvious reader: four numbers are two samples; a chirp is its receivers in order."""
    i, q = (rng.integers(-32_768, 32_768, (3, 4, 6)).astype(np.int16) for _ in range(2))
    words = np.frombuffer(to_dca1000(i, q, "xwr16xx"), dtype="<i2").astype(int)
    samples = []
    for k in range(0, len(words), 4):
        samples += [words[k] + 1j * words[k + 2], words[k + 1] + 1j * words[k + 3]]
    for chirp in range(3):
        for receiver in range(4):
            for t in range(6):
                assert samples.pop(0) == i[chirp, receiver, t] + 1j * q[chirp, receiver, t]


@pytest.mark.parametrize("device", LVDS_LANES)
@pytest.mark.parametrize("receivers", [1, 2, 4])
def test_round_trip(device, receivers, rng):
    i, q = (rng.integers(-32_768, 32_768, (5, receivers, 8)).astype(np.int16) for _ in range(2))
    for found, expected in zip(
        from_dca1000(to_dca1000(i, q, device), device, receivers, 8), (i, q), strict=True
    ):
        np.testing.assert_array_equal(found, expected)


def test_little_endian():
    assert to_dca1000(*numbered(1, 1, 2), "xwr68xx")[:4] == b"\x01\x00\x02\x00"


@pytest.mark.parametrize(
    ("shape", "device"),
    [((1, 1, 3), "xwr18xx"), ((1, 3, 4), "xwr18xx"), ((1, 5, 4), "xwr14xx"), ((1, 1, 4), "awr")],
)
def test_what_no_device_records_is_refused(shape, device):
    with pytest.raises(RadarError):
        to_dca1000(*numbered(*shape), device)


def test_a_cut_recording_is_refused():
    with pytest.raises(RadarError, match="whole number"):
        from_dca1000(to_dca1000(*numbered(2, 1, 4), "xwr18xx")[:-2], "xwr18xx", 1, 4)
