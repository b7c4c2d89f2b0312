"""A compact scan comes back as it was saved."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from waveformer.simulator.compact import compact, restore
from waveformer.simulator.compact_store import load_compact, load_restored, save_compact
from waveformer.simulator.errors import RadarError, StoreError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.points import simulate_points
from waveformer.simulator.radar import Aperture, Chirp

GATE_M = (0.2, 0.5)


@pytest.fixture
def measurement(rng: np.random.Generator) -> Measurement:
    points_m = rng.uniform([-0.05, -0.05, -0.4], [0.05, 0.05, -0.3], size=(20, 3))
    chirp, grid = Chirp.from_preset("mito"), Aperture.planar_grid(10, 8, 0.01)
    return simulate_points(points_m, np.full(20, 1e-3), chirp, Aperture(grid.tx_m, grid.tx_m - [0.01, 0, 0]))


def test_round_trip_is_exact(tmp_path: Path, measurement: Measurement) -> None:
    packed = compact(measurement.h, measurement.chirp, GATE_M)
    save_compact(tmp_path / "c.zarr", packed, measurement.aperture, range_bias_m=0.1, metadata={"seed": 0})
    loaded, aperture, rest = load_compact(tmp_path / "c.zarr")
    assert restore(loaded).tobytes() == restore(packed).tobytes()
    assert np.array_equal(loaded.basis.nodes, packed.basis.nodes)
    assert loaded.basis.chirp == measurement.chirp
    assert (loaded.basis.near_m, loaded.basis.far_m) == GATE_M
    assert loaded.basis.echo_error == packed.basis.echo_error
    assert np.array_equal(aperture.receivers_m, measurement.aperture.receivers_m)
    assert rest == {"range_bias_m": 0.1, "metadata": {"seed": 0}}


def test_the_full_scan_is_restored_to_60_db(tmp_path: Path, measurement: Measurement) -> None:
    packed = compact(measurement.h, measurement.chirp, GATE_M)
    save_compact(tmp_path / "c.zarr", packed, measurement.aperture)
    restored = load_restored(tmp_path / "c.zarr")
    lost = np.linalg.norm(restored.h - measurement.h, axis=1) / np.linalg.norm(measurement.h, axis=1)
    assert 20 * np.log10(lost.max()) <= -60


def test_a_compact_scan_is_no_measurement(tmp_path: Path, measurement: Measurement) -> None:
    packed = compact(measurement.h, measurement.chirp, GATE_M)
    with pytest.raises(RadarError, match="80 signals do not fit 79 positions"):
        save_compact(tmp_path / "c.zarr", packed, Aperture(measurement.aperture.tx_m[:79]))
    save_compact(tmp_path / "c.zarr", packed, measurement.aperture)
    with pytest.raises(StoreError, match=r"holds a waveformer\.compact_measurement"):
        Measurement.load(tmp_path / "c.zarr")
