"""A scan comes back as it was saved, or not at all."""

import json
import pickle

import numpy as np
import pytest
import zarr

from waveformer.simulator.errors import RadarError, StoreError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

CHIRP = Chirp(77e9, 4e9, 32)
RNG = np.random.default_rng(0)


def make(num_positions: int = 6, *, bistatic: bool = False) -> Measurement:
    tx_m = RNG.normal(size=(num_positions, 3))
    h = RNG.normal(size=(num_positions, 32)) + 1j * RNG.normal(size=(num_positions, 32))
    aperture = Aperture(tx_m, tx_m + 0.01 if bistatic else None)
    return Measurement(h.astype(np.complex64), CHIRP, aperture, 0.125, {"seed": 0, "list": [1, 2.5, None]})


@pytest.fixture
def stored(tmp_path):
    path = tmp_path / "scan.zarr"
    make(2000).save(path)  # two chunks
    return path


@pytest.mark.parametrize("bistatic", [False, True])
def test_round_trip_is_exact(tmp_path, bistatic):
    saved = make(bistatic=bistatic)
    saved.save(tmp_path / "scan.zarr")
    loaded = Measurement.load(tmp_path / "scan.zarr")
    assert loaded.h.tobytes() == saved.h.tobytes()
    assert loaded.h.dtype == np.complex64
    assert loaded.chirp == saved.chirp
    assert loaded.aperture.is_monostatic is not bistatic
    np.testing.assert_array_equal(loaded.aperture.receivers_m, saved.aperture.receivers_m)
    assert (loaded.range_bias_m, loaded.metadata) == (saved.range_bias_m, saved.metadata)


def test_nan_samples_survive(tmp_path):
    h = np.full((1, 32), np.nan + 1j, np.complex64)
    Measurement(h, CHIRP, Aperture(np.zeros((1, 3)))).save(tmp_path / "scan.zarr")
    assert Measurement.load(tmp_path / "scan.zarr").h.tobytes() == h.tobytes()


def test_any_zarr_reader_opens_the_store(stored):
    group = zarr.open_group(stored, mode="r")
    assert group.metadata.zarr_format == 3
    assert group["h"].shape == (2000, 32)
    assert group["h"].chunks == (1024, 32)
    assert group["h"].metadata.dimension_names == ("position", "sample")
    assert np.isnan(group["h"].fill_value)
    assert "consolidated_metadata" not in json.loads((stored / "zarr.json").read_text())
    assert group.attrs["format"] == "waveformer.measurement"


@pytest.mark.parametrize("chunk", ["h/c/0/0", "h/c/1/0", "tx_m/c/0/0"])
@pytest.mark.parametrize("damage", ["delete", "empty", "halve", "flip"])
def test_damaged_chunks_are_refused(stored, chunk, damage):
    file = stored / chunk
    data = bytearray(file.read_bytes())
    if damage == "delete":
        file.unlink()
    elif damage == "flip":
        data[len(data) // 2] ^= 4
        file.write_bytes(data)
    else:
        file.write_bytes(data[: len(data) // 2] if damage == "halve" else b"")
    with pytest.raises(StoreError, match=r"scan\.zarr is damaged") as caught:
        Measurement.load(stored)
    assert "\n" not in str(caught.value)


def test_edited_attributes_are_refused(stored):
    text = (stored / "zarr.json").read_text()
    (stored / "zarr.json").write_text(text.replace("77000000000.0", "76000000000.0"))
    with pytest.raises(StoreError, match="attributes differ"):
        Measurement.load(stored)


@pytest.mark.parametrize("name", ["zarr.json", "h/zarr.json", "tx_m/zarr.json"])
def test_lost_metadata_are_refused(stored, name):
    (stored / name).unlink()
    with pytest.raises(StoreError, match=r"scan\.zarr is (not a waveformer store|damaged)"):
        Measurement.load(stored)


def test_other_things_are_refused(tmp_path, stored):
    with pytest.raises(StoreError, match="does not exist"):
        Measurement.load(tmp_path / "absent.zarr")
    (tmp_path / "text").write_text("x")
    with pytest.raises(StoreError, match="not a waveformer store"):
        Measurement.load(tmp_path / "text")
    zarr.open_group(stored).attrs["format"] = "waveformer.image"
    with pytest.raises(StoreError, match=r"holds a waveformer\.image"):
        Measurement.load(stored)


def test_newer_schema_is_refused(stored):
    zarr.open_group(stored).attrs["schema_version"] = 2
    with pytest.raises(StoreError, match="schema version 2; this waveformer reads up to 1"):
        Measurement.load(stored)


def test_nonsense_is_refused():
    aperture = Aperture(np.zeros((6, 3)))
    with pytest.raises(RadarError, match=r"\(6, 32\), got \(5, 32\)"):
        Measurement(np.zeros((5, 32), np.complex64), CHIRP, aperture)
    with pytest.raises(RadarError, match="must be complex"):
        Measurement(np.zeros((6, 32)), CHIRP, aperture)
    with pytest.raises(RadarError, match="range_bias_m"):
        Measurement(np.zeros((6, 32), np.complex64), CHIRP, aperture, range_bias_m=np.nan)
    with pytest.raises(StoreError, match="JSON"):
        Measurement(np.zeros((6, 32), np.complex64), CHIRP, aperture, metadata={"f": print})


def test_measurement_is_frozen_and_picklable():
    measurement = make()
    with pytest.raises(ValueError, match="read-only"):
        measurement.h[0, 0] = 1
    assert pickle.loads(pickle.dumps(measurement)).h.tobytes() == measurement.h.tobytes()


def test_range_profile_peaks_at_range_and_amplitude():
    range_m, amplitude, bias_m = 0.4, 3e-5, 0.1
    delay_s = (2 * range_m + bias_m) / SPEED_OF_LIGHT_M_PER_S
    h = amplitude * np.exp(-2j * np.pi * CHIRP.frequencies_hz * delay_s)[None]
    measurement = Measurement(h, CHIRP, Aperture(np.zeros((1, 3))), range_bias_m=bias_m)
    axis_m, magnitude = measurement.range_profile(oversampling=16)
    peak = int(magnitude[0].argmax())
    assert abs(axis_m[peak] - range_m) <= CHIRP.range_bin_m / 32 + 1e-12  # half a profile step
    # The Dirichlet kernel is down by (pi x)^2 / 6 at x = 1/32 bin: 0.16 %.
    assert magnitude[0, peak] == pytest.approx(amplitude, rel=2e-3)


def test_bias_correction_leaves_the_echo_of_the_true_range():
    path_m, bias_m = 0.8, 0.1
    late, true = (
        np.exp(-2j * np.pi * CHIRP.frequencies_hz * path / SPEED_OF_LIGHT_M_PER_S)
        for path in (path_m + bias_m, path_m)
    )
    measurement = Measurement(late[None], CHIRP, Aperture(np.zeros((1, 3))), range_bias_m=bias_m)
    # h is single precision
    assert np.abs(measurement.h[0] * measurement.bias_correction - true).max() < 1e-6
