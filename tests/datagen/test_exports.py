"""Exports: other programs find every number, an interrupted export goes on, nothing is replaced by accident."""

from __future__ import annotations

import hashlib
import io
import json
import sys
import tarfile
from pathlib import Path

import h5py
import numpy as np
import pytest

from waveformer.datagen.dataset_files import shard_file
from waveformer.datagen.dataset_reader import open_dataset
from waveformer.datagen.export_choice import ExportChoice
from waveformer.datagen.export_dca1000 import export_dca1000, read_dca1000
from waveformer.datagen.export_hdf5 import export_hdf5
from waveformer.datagen.export_npz import export_npz
from waveformer.datagen.export_webdataset import export_webdataset
from waveformer.simulator import Aperture, Chirp
from waveformer.simulator.errors import StoreError

sys.path.append(str(Path(__file__).parent))
import reading_makers as makers

COUNT = 10
COMMITTED = [index for index in range(COUNT) if index not in makers.QUARANTINED]
TO_FOLDER = [export_npz, export_webdataset, export_dca1000]


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return makers.make(tmp_path_factory.mktemp("exports") / "store", COUNT)


@pytest.fixture
def choice(store):
    return ExportChoice.choose(open_dataset(store))


def digests(folder):
    """SHA-256 of every file."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file()
    }


def assert_sample(found, index, names=None):
    expected = makers.arrays_of(index)
    for name in names or expected:
        assert found[name].dtype == expected[name].dtype
        np.testing.assert_array_equal(found[name], expected[name])


def test_npz(choice, tmp_path):
    out = tmp_path / "new" / "npz"
    calls = []
    export_npz(choice, out, progress=lambda *call: calls.append(call))
    assert calls[-1] == (8, 8)
    assert {path.name for path in out.iterdir()} == {"export.json", "radar.npz", "samples"}
    assert sorted(path.stem for path in (out / "samples").iterdir()) == [f"{k:08d}" for k in COMMITTED]
    for index in COMMITTED:
        with np.load(out / "samples" / f"{index:08d}.npz") as file:
            assert_sample(file, index)
            assert json.loads(str(file["record"])) == {"index": index, **choice.data.record(index)}
    with np.load(out / "radar.npz") as radar:
        np.testing.assert_array_equal(radar["frequencies_hz"], Chirp(77.5001e9, 3.0009e9, 8).frequencies_hz)
        np.testing.assert_array_equal(radar["tx_m"], Aperture.planar_grid(4, 3, 0.004).tx_m)
    description = json.loads((out / "export.json").read_text())
    assert description["arrays"]["truth_m"]["unit"] == "m"
    assert description["dataset"]["settings"] == makers.SETTINGS


def test_hdf5(choice, tmp_path):
    export_hdf5(choice, tmp_path / "all.h5")
    with h5py.File(tmp_path / "all.h5") as file:
        assert file["sample_index"][:].tolist() == COMMITTED
        for row, index in enumerate(COMMITTED):
            assert_sample({info.name: file[info.name][row] for info in makers.ARRAYS}, index)
            assert json.loads(file["record"].asstr()[row])["index"] == index
        assert file["truth_m"].attrs["units"] == "m"
        assert [axis.label for axis in file["h"].dims] == ["sample", "position", "chirp_sample"]
        assert file["h"].dims[2][0].name == "/frequencies_hz"
        assert file["truth_m"].dims[0][0].name == "/sample_index"
        assert file["tx_m"].shape == (12, 3)
        assert json.loads(file.attrs["description"])["num_samples"] == 8


def test_webdataset(choice, tmp_path):
    out = tmp_path / "tars"
    export_webdataset(choice, out, shard_bytes=3 * choice.sample_bytes)
    shards = sorted((out / "samples").iterdir())
    assert [path.name for path in shards] == [f"shard-{k:06d}.tar" for k in range(3)]
    keys = []
    for path in shards:
        with tarfile.open(path) as tar:
            found = {}
            for member in tar:
                key, name = member.name.split(".", 1)  # the convention: up to the first dot
                found.setdefault(key, {})[name] = tar.extractfile(member).read()
        for key, files in found.items():
            keys.append(int(key))
            arrays = {name[:-4]: np.load(io.BytesIO(files[name])) for name in files if name.endswith(".npy")}
            assert_sample(arrays, int(key))
            assert json.loads(files["json"])["index"] == int(key)
    assert keys == COMMITTED


@pytest.mark.parametrize("device", ["xwr18xx", "xwr14xx"])
def test_dca1000(choice, tmp_path, device):
    out = tmp_path / "recordings"
    export_dca1000(choice, out, device=device)
    for index in COMMITTED:
        path = out / "samples" / f"{index:08d}.bin"
        sidecar = json.loads(path.with_suffix(".json").read_text())
        lanes_stored = {"xwr18xx": 1, "xwr14xx": 4}[device]
        assert path.stat().st_size == lanes_stored * 2 * 2 * 12 * 8
        expected = makers.arrays_of(index)["h"]
        error = read_dca1000(path) - expected
        # half a step of rounding, and complex64's own
        step = 0.5 * sidecar["scale"] + 1e-6 * np.abs(expected).max()
        assert max(np.abs(error.real).max(), np.abs(error.imag).max()) <= step
        words = np.frombuffer(path.read_bytes(), dtype="<i2")
        assert np.abs(words.astype(int)).max() == 32_767
    # these radars see the phase rise with the range: the other sign than ours
    q0 = words[2 if device == "xwr18xx" else 4]
    assert np.sign(q0) == -np.sign(makers.arrays_of(COMMITTED[-1])["h"][0, 0].imag)


def test_a_damaged_recording_is_refused(choice, tmp_path):
    export_dca1000(choice, tmp_path / "out")
    path = tmp_path / "out" / "samples" / "00000000.bin"
    content = bytearray(path.read_bytes())
    content[7] ^= 4
    path.write_bytes(content)
    with pytest.raises(StoreError, match="damaged"):
        read_dca1000(path)
    path.unlink()
    with pytest.raises(StoreError, match="cannot be read"):
        read_dca1000(path)


@pytest.mark.parametrize("export", TO_FOLDER)
def test_an_interrupted_export_goes_on(store, choice, tmp_path, monkeypatch, export):
    settings = {"shard_bytes": choice.sample_bytes} if export is export_webdataset else {}
    export(choice, tmp_path / "whole", **settings)

    def stop(done, total):
        if done == 5:
            raise KeyboardInterrupt

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        export(choice, out, progress=stop, **settings)
    assert not out.exists()
    (tmp_path / ".out.unfinished" / "samples" / ".x.bin.y.partial").mkdir()  # as kill -9 leaves it
    read = []
    original = type(choice.data).read
    monkeypatch.setattr(
        type(choice.data), "read", lambda self, k, names: read.append(k) or original(self, k, names)
    )
    export(choice, out, **settings)
    assert read == COMMITTED[5:]
    assert digests(out) == digests(tmp_path / "whole")
    assert {path.name for path in tmp_path.iterdir()} == {"out", "whole"}


@pytest.mark.parametrize("export", TO_FOLDER)
def test_what_is_there_is_replaced_only_on_request(store, choice, tmp_path, export):
    out = tmp_path / "out"
    export(choice, out)
    before = digests(out)
    fewer = ExportChoice.choose(open_dataset(store), limit=2)
    with pytest.raises(StoreError, match="--force"):
        export(fewer, out)
    assert digests(out) == before
    export(fewer, out, overwrite=True)
    assert json.loads((out / "export.json").read_text())["num_samples"] == 2
    (tmp_path / "photos").mkdir()
    with pytest.raises(StoreError, match="never replaced"):
        export(choice, tmp_path / "photos", overwrite=True)


def test_an_unfinished_export_of_other_samples(store, choice, tmp_path):
    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_npz(choice, tmp_path / "out", progress=stop)
    fewer = ExportChoice.choose(open_dataset(store), splits=["evaluation"])
    with pytest.raises(StoreError, match="other samples"):
        export_npz(fewer, tmp_path / "out")
    export_npz(fewer, tmp_path / "out", overwrite=True)
    assert len(list((tmp_path / "out" / "samples").iterdir())) == 2


def test_hdf5_is_complete_or_not_there(choice, tmp_path):
    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_hdf5(choice, tmp_path / "all.h5", progress=stop)
    assert not list(tmp_path.iterdir())
    (tmp_path / "all.h5").write_text("mine")
    with pytest.raises(StoreError, match="--force"):
        export_hdf5(choice, tmp_path / "all.h5")
    assert (tmp_path / "all.h5").read_text() == "mine"


def test_a_damaged_dataset_is_not_exported(tmp_path):
    store = makers.make(tmp_path / "store", 4)
    path = store / shard_file("pose", 0, 2)
    content = bytearray(path.read_bytes())
    content[40] ^= 1
    path.write_bytes(content)
    choice = ExportChoice.choose(open_dataset(store))
    for export in (export_npz, export_webdataset, export_hdf5):
        with pytest.raises(StoreError, match="damaged"):
            export(choice, tmp_path / "out")
        assert not (tmp_path / "out").exists()


def test_signals_are_needed_for_recordings(store, tmp_path):
    with pytest.raises(StoreError, match="no signals"):
        export_dca1000(ExportChoice.choose(open_dataset(store), names=["pose"]), tmp_path / "out")
