"""The factory: every sample is made once, whoever makes it and whatever happens to it."""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))  # the makers, as their child processes import them

from factory_makers import layout, plain
from factory_support import HERE, digests, made_dataset, new_dataset, start_run

from waveformer.datagen.dataset_audit import audit, damaged_shards, quarantined_shards, sweep, withdraw
from waveformer.datagen.dataset_files import commit_path, lock_path
from waveformer.datagen.dataset_reader import open_dataset
from waveformer.datagen.dataset_store import create_dataset, read_layout
from waveformer.datagen.factory_run import Partition, run_factory
from waveformer.datagen.factory_shard import ShardMaker
from waveformer.simulator.errors import RadarError, StoreError
from waveformer.simulator.file_lock import FileLock


@pytest.fixture(autouse=True)
def makers_can_be_imported(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE), before])
    try:
        return made_dataset(tmp_path_factory.mktemp("undisturbed") / "store")
    finally:
        os.environ["PYTHONPATH"] = before


def commits(root):
    """When each commit record was written, by name."""
    return {path.name: path.stat().st_mtime_ns for path in (root / "commit").glob("*.json")}


def test_a_run_makes_every_sample(undisturbed):
    data = open_dataset(undisturbed)
    assert data.indices.tolist() == list(range(14)) and not data.quarantined and data.num_pending == 0
    for index in (0, 5, 13):
        arrays, record = plain("", index)
        found = data.read(index)
        for name, values in arrays.items():
            np.testing.assert_array_equal(found[name], values)
        assert data.record(index) == record


def test_any_zarr_reader_opens_the_arrays(undisturbed):
    import zarr

    group = zarr.open_group(undisturbed / "samples.zarr", mode="r")
    np.testing.assert_array_equal(group["h"][5], plain("", 5)[0]["h"])
    assert group["cloud_m"].metadata.dimension_names == ("sample", "point", "axis")
    assert group["cloud_m"].attrs["units"] == "m"


def test_a_second_run_changes_nothing(undisturbed):
    before = digests(undisturbed)
    state = run_factory(undisturbed)
    assert (state.committed, state.written) == (14, 0) and digests(undisturbed) == before


def test_samples_have_the_same_bytes_in_any_order_and_any_part(undisturbed, tmp_path):
    root = new_dataset(tmp_path / "store")
    maker = ShardMaker(root)
    maker.make(3)
    maker.make(1)
    maker.close()
    parts = [run_factory(root, partition=Partition(index, 2)) for index in (1, 0)]
    assert sum(part.requested for part in parts) == 14
    assert digests(root) == digests(undisturbed)


def test_poison_is_quarantined_and_the_rest_is_made(tmp_path, undisturbed):
    root = new_dataset(tmp_path / "store", maker="poison", time_limit_s=4.0, memory_limit_bytes=2 * 2**30)
    state = run_factory(root)
    assert (state.committed, state.quarantined, state.pending) == (10, 4, 0)
    reasons = open_dataset(root).quarantined
    assert "SIGSEGV" in reasons[2] and "4 s" in reasons[5] and "no faces" in reasons[9]
    assert "memory" in reasons[11] or "4 s" in reasons[11]
    assert all("\n" not in reason for reason in reasons.values())
    for index in open_dataset(root).indices:
        np.testing.assert_array_equal(
            open_dataset(root).read(index)["h"], open_dataset(undisturbed).read(index)["h"]
        )
    with pytest.raises(StoreError, match=r"sample 9 is quarantined \(nine: no faces"):
        open_dataset(root).read(9)


def test_a_sample_that_dies_once_is_made(tmp_path, undisturbed):
    root = made_dataset(tmp_path / "store", maker="crashes_once")
    assert len(open_dataset(root)) == 14
    np.testing.assert_array_equal(open_dataset(root).read(1)["h"], plain("", 1)[0]["h"])


def test_quarantined_samples_can_be_tried_again(tmp_path):
    root = made_dataset(tmp_path / "store", maker="poison", time_limit_s=1.0, memory_limit_bytes=2 * 2**30)
    shards = quarantined_shards(root, read_layout(root))
    assert shards == [0, 1, 2]
    withdraw(root, shards)
    assert audit(root).pending == 12


def test_other_settings_are_refused_by_name(undisturbed):
    with pytest.raises(StoreError, match=r"other settings \(maker"):
        create_dataset(undisturbed, layout(14, "slow"), {}, {})


def test_something_else_is_never_touched(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(StoreError, match="not empty and holds no dataset"):
        create_dataset(tmp_path, layout(4), {}, {})
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(("index", "count"), [(2, 2), (-1, 3), (0, 0)])
def test_a_part_must_exist(index, count):
    with pytest.raises(RadarError, match="shard-index"):
        Partition(index, count)


def test_what_another_run_makes_is_left_to_it(tmp_path):
    root = new_dataset(tmp_path / "store")
    lock = FileLock(lock_path(root, 2))
    try:
        maker = ShardMaker(root)
        assert maker.make(2).busy
        maker.close()
    finally:
        lock.release()
    assert not commit_path(root, 2).exists()


def test_two_runs_at_once_share_the_work(tmp_path, undisturbed):
    root = new_dataset(tmp_path / "store")
    runs = [start_run(root) for _ in range(2)]
    for run in runs:
        out, err = run.communicate(timeout=120)
        assert run.returncode == 0, err
        assert out.strip() == "14 requested = 14 committed + 0 quarantined + 0 pending"
    assert digests(root) == digests(undisturbed)


@pytest.mark.parametrize("wanted", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_killed_runs_go_on(tmp_path, rng, capsys, wanted):
    """kill -9 of the whole process group at random moments: nothing lost, nothing double, nothing false."""
    samples = 12 * wanted
    undisturbed = made_dataset(tmp_path / "whole", maker="slow", num_samples=samples)
    root = new_dataset(tmp_path / "store", maker="slow", num_samples=samples)
    kills, lost, false = 0, 0, 0
    first_written = {}
    while audit(root).pending:
        run = start_run(root)
        goal = len(commits(root)) + int(rng.integers(0, 3))
        while kills < wanted and run.poll() is None and len(commits(root)) < goal:
            time.sleep(0.01)
        if kills < wanted:
            time.sleep(float(rng.uniform(0.0, 0.25)))
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGKILL)
                kills += 1
        run.communicate()
        found = audit(root)
        assert found.requested == found.committed + found.quarantined + found.pending == samples
        false += len(found.damaged)
        now = commits(root)
        lost += len(first_written.keys() - now.keys())
        first_written = {**now, **first_written}
    double = sum(first_written[name] != written for name, written in commits(root).items())
    sweep(root)
    with capsys.disabled():
        print(
            f"\n{kills} kills of the group: {audit(root).balance}; {lost} lost, {double} double, {false} false"
        )
    assert kills == wanted and (lost, double, false) == (0, 0, 0)
    assert digests(root) == digests(undisturbed)


@pytest.mark.parametrize("array", ["cloud_m", "h", "count"])
def test_every_flipped_bit_is_found(tmp_path, undisturbed, rng, array):
    import shutil

    root = Path(shutil.copytree(undisturbed, tmp_path / "store"))
    files = sorted(path for path in (root / "samples.zarr" / array / "c").rglob("*") if path.is_file())
    found = seen = 0
    for _ in range(20):
        path = files[rng.integers(len(files))]
        good = path.read_bytes()
        bad = bytearray(good)
        bad[rng.integers(len(bad))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bad)
        found += len(audit(root).damaged) == 1
        try:
            for index in open_dataset(root).indices:
                open_dataset(root).read(index, [array])
        except StoreError:
            seen += 1
        path.write_bytes(good)
    print(f"{array}: {found} of 20 bit flips found by verify, {seen} when read")
    assert found == 20 and seen >= 19  # a byte between chunks is read by nobody


@pytest.mark.parametrize("size", [0, 1, "half", "deleted"])
def test_truncated_and_deleted_files_are_found_and_made_again(tmp_path, undisturbed, size):
    import shutil

    root = Path(shutil.copytree(undisturbed, tmp_path / "store"))
    shard = root / "samples.zarr/h/c/1/0/0"
    record = commit_path(root, 2)
    for path in (shard, record):
        content = path.read_bytes()
        if size == "deleted":
            path.unlink()
        else:
            path.write_bytes(content[: len(content) // 2 if size == "half" else size])
    if size == "deleted":
        assert audit(root).pending == 4 and len(audit(root).damaged) == 1  # no record: simply not made
    else:
        assert len(audit(root).damaged) == 2
    withdraw(root, damaged_shards(root, read_layout(root)))
    run_factory(root)
    assert digests(root) == digests(undisturbed)


def test_a_full_disk_ends_the_run_and_loses_nothing(tmp_path, undisturbed, monkeypatch):
    from waveformer.datagen import factory_shard

    root = new_dataset(tmp_path / "store")
    genuine = factory_shard.write_shard

    def full(root, layout, shard, samples):
        if shard == 2:
            raise OSError(28, "No space left on device")
        genuine(root, layout, shard, samples)

    monkeypatch.setattr(factory_shard, "write_shard", full)
    with pytest.raises(StoreError, match="No space left"):
        run_factory(root)
    assert audit(root).committed == 8 and not audit(root).damaged
    monkeypatch.undo()
    monkeypatch.setenv("PYTHONPATH", str(HERE))
    run_factory(root)
    assert digests(root) == digests(undisturbed)
