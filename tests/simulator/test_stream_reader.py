"""Rows of a stored scan are those that were saved, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waveformer.simulator.errors import StoreError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.stream_reader import StreamReader


@pytest.fixture
def measurement(rng: np.random.Generator) -> Measurement:
    tx_m = rng.normal(size=(2500, 3))
    h = rng.normal(size=(2500, 8)) + 1j * rng.normal(size=(2500, 8))
    return Measurement(h, Chirp(77e9, 4e9, 8), Aperture(tx_m, tx_m + 0.01), 0.15, {"seed": 3})


def test_rows_are_those_that_were_saved(tmp_path: Path, measurement: Measurement) -> None:
    measurement.save(tmp_path / "scan.zarr")
    reader = StreamReader(tmp_path / "scan.zarr")
    assert reader.chirp == measurement.chirp
    assert np.array_equal(reader.aperture.tx_m, measurement.aperture.tx_m)
    assert np.array_equal(reader.aperture.receivers_m, measurement.aperture.receivers_m)
    assert (reader.range_bias_m, reader.metadata) == (0.15, {"seed": 3})
    for rows in (slice(0, 1), slice(1000, 2100), slice(2048, 2500)):
        assert reader.rows(rows).tobytes() == measurement.h[rows].tobytes()


@pytest.mark.parametrize("damage", ["delete", "flip"])
def test_a_damaged_chunk_is_refused(tmp_path: Path, measurement: Measurement, damage: str) -> None:
    measurement.save(tmp_path / "scan.zarr")
    chunk = tmp_path / "scan.zarr/h/c/1/0"
    data = bytearray(chunk.read_bytes())
    data[7] ^= 1
    chunk.unlink()
    if damage == "flip":
        chunk.write_bytes(data)
    with pytest.raises(StoreError, match="is damaged"):
        StreamReader(tmp_path / "scan.zarr").rows(slice(1000, 1100))


def test_what_is_no_scan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="does not exist"):
        StreamReader(tmp_path / "scan.zarr")
