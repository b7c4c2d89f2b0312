"""A streamed scan is the scan that `save` writes, whatever happened on the way."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from waveformer.simulator.errors import StoreError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.storage import unfinished_folder
from waveformer.simulator.stream_store import StreamWriter

CHIRP = Chirp(77e9, 4e9, 8)
COUNT = 4000  # four chunks in two blocks of 2048 rows, the last chunk and block not full
APERTURE = Aperture.planar_grid(80, 50, 0.004)
BISTATIC = Aperture(APERTURE.tx_m, APERTURE.tx_m - [0.005, 0, 0])
INPUTS = {"targets": ["ab12"], "seed": 0}
METADATA = {"seed": 0, "mode": "fast"}


class PowerCut(BaseException):
    """Nobody catches it, so nothing is cleaned up."""


def signals() -> NDArray[np.complex64]:
    rng = np.random.default_rng(5)
    return (rng.normal(size=(COUNT, 8)) + 1j * rng.normal(size=(COUNT, 8))).astype(np.complex64)


H = signals()


def start(path: Path, aperture: Aperture = APERTURE, inputs: Any = INPUTS, **options: Any) -> StreamWriter:
    return StreamWriter.open(path, CHIRP, aperture, inputs, block_positions=2048, **options)


def run(path: Path, **options: Any) -> int:
    """The whole scan; returns how many blocks were computed."""
    with start(path, **options) as writer:
        missing = writer.missing_blocks()
        for rows in missing:
            writer.write(rows.start, H[rows])
        writer.finish(range_bias_m=0.15, metadata=METADATA)
    return len(missing)


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    path = tmp_path_factory.mktemp("saved") / "scan.zarr"
    Measurement(H, CHIRP, APERTURE, 0.15, METADATA).save(path)
    return files(path)


def test_a_streamed_scan_is_byte_for_byte_a_saved_one(tmp_path: Path, saved: dict[str, bytes]) -> None:
    assert run(tmp_path / "scan.zarr") == 2
    assert files(tmp_path / "scan.zarr") == saved
    assert os.listdir(tmp_path) == ["scan.zarr"]
    loaded = Measurement.load(tmp_path / "scan.zarr")
    assert np.array_equal(loaded.h, H)
    assert (loaded.range_bias_m, loaded.metadata) == (0.15, METADATA)


def test_blocks_may_come_in_any_order_and_precision(tmp_path: Path, saved: dict[str, bytes]) -> None:
    with start(tmp_path / "scan.zarr") as writer:
        for rows in reversed(writer.missing_blocks()):
            writer.write(rows.start, H[rows].astype(np.complex128))
        writer.finish(range_bias_m=0.15, metadata=METADATA)
    assert files(tmp_path / "scan.zarr") == saved


def test_receivers_are_kept(tmp_path: Path) -> None:
    run(tmp_path / "scan.zarr", aperture=BISTATIC)
    Measurement(H, CHIRP, BISTATIC, 0.15, METADATA).save(tmp_path / "saved.zarr")
    assert files(tmp_path / "scan.zarr") == files(tmp_path / "saved.zarr")


def test_a_scan_interrupted_before_any_flush_resumes_to_the_same_bytes(
    tmp_path: Path, saved: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every step towards durability ends in fsync, so the power is cut before each of them in turn."""
    fsync, left = os.fsync, 0

    def cut(descriptor: int) -> None:
        nonlocal left
        if left == 0:
            raise PowerCut
        left -= 1
        fsync(descriptor)

    steps = 0
    while True:
        path = tmp_path / str(steps) / "scan.zarr"
        left = steps
        monkeypatch.setattr(os, "fsync", cut)
        try:
            run(path)
        except PowerCut:
            pass
        else:
            break
        finally:
            monkeypatch.setattr(os, "fsync", fsync)
        if not path.exists():  # the last cuts come after the renaming
            with pytest.raises(StoreError, match=r"is unfinished: .*--resume|does not exist"):
                Measurement.load(path)
            with pytest.raises(StoreError, match=r"waveformer store|unfinished"):
                Measurement.load(unfinished_folder(path))
            run(path, resume=True)
        assert files(path) == saved
        steps += 1
    assert steps > 20


CHILD = """
import os, signal, sys
import numpy as np
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import test_stream_store as t
from waveformer.simulator.journal import Journal
path, resume = Path(sys.argv[2]), sys.argv[3] == "resume"
append = Journal.append
def killed(self, entry):
    if entry["first_row"] == 2048:
        self._file.write(b'{"first_row": 20')
        self._file.flush()
        os.kill(os.getpid(), signal.SIGKILL)
    append(self, entry)
Journal.append = killed
t.run(path, resume=resume)
"""


def test_kill_9_in_the_middle_of_a_journal_line(tmp_path: Path, saved: dict[str, bytes]) -> None:
    path = tmp_path / "scan.zarr"
    arguments = [sys.executable, "-c", CHILD, str(Path(__file__).parent), str(path)]
    assert subprocess.run([*arguments, "begin"], check=False).returncode == -signal.SIGKILL
    assert not path.exists()
    assert subprocess.run([*arguments, "resume"], check=False).returncode == -signal.SIGKILL
    assert run(path, resume=True) == 1  # the first block survived both
    assert files(path) == saved


@pytest.mark.parametrize("damage", ["delete", "flip", "halve", "empty"])
def test_a_damaged_block_is_computed_again(tmp_path: Path, saved: dict[str, bytes], damage: str) -> None:
    path = tmp_path / "scan.zarr"
    with start(path) as writer:
        for rows in writer.missing_blocks():
            writer.write(rows.start, H[rows])
        chunk = unfinished_folder(path) / "store/h/c/1/0"
        data = bytearray(chunk.read_bytes())
        data[100] ^= 1
        if damage == "delete":
            chunk.unlink()
        else:
            chunk.write_bytes({"flip": data, "halve": data[: len(data) // 2], "empty": b""}[damage])
        with pytest.raises(StoreError, match=r"rows 0 \.\. 2047 are no longer .*--resume"):
            writer.finish()
    assert not path.exists()
    with start(path, resume=True) as writer:
        assert writer.missing_blocks() == [slice(0, 2048)]
    assert run(path, resume=True) == 1
    assert files(path) == saved


def test_a_journal_that_claims_too_much_is_not_believed(tmp_path: Path, saved: dict[str, bytes]) -> None:
    path = tmp_path / "scan.zarr"
    with start(path) as writer:
        writer.write(0, H[:2048])
    with (unfinished_folder(path) / "journal.jsonl").open("a") as journal:
        journal.write(json.dumps({"first_row": 2048, "sha256": "0" * 64}) + "\nnonsense\n")
    assert run(path, resume=True) == 1
    assert files(path) == saved


def test_what_zarr_left_half_written_is_not_published(tmp_path: Path, saved: dict[str, bytes]) -> None:
    path = tmp_path / "scan.zarr"
    with start(path) as writer:
        writer.write(0, H[:2048])
    (unfinished_folder(path) / "store/h/c/1/0.1234.partial").write_bytes(b"half")
    (unfinished_folder(path) / "store/h/zarr.json").write_bytes(b"{")
    assert run(path, resume=True) == 1
    assert files(path) == saved


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"inputs": INPUTS | {"seed": 1}}, "different seed:"),
        ({"inputs": {"targets": ["ab12"]}}, "different seed:"),
        ({"inputs": INPUTS | {"seed": 1, "mode": "exact"}}, "different mode, seed:"),
        ({"aperture": BISTATIC}, "different rx_m:"),
    ],
)
def test_other_inputs_are_not_resumed(tmp_path: Path, change: dict[str, Any], says: str) -> None:
    with start(tmp_path / "scan.zarr") as writer:
        writer.write(0, H[:2048])
    with pytest.raises(StoreError, match=f"{says} resume with the same inputs, or start anew with --force"):
        start(tmp_path / "scan.zarr", resume=True, **change)
    with start(tmp_path / "scan.zarr", resume=True) as writer:  # and the refusal did no harm
        assert len(writer.missing_blocks()) == 1


def test_another_chirp_or_block_size_is_not_resumed(tmp_path: Path) -> None:
    start(tmp_path / "scan.zarr").close()
    other = Chirp(77e9, 4e9, 9)
    with pytest.raises(StoreError, match="different block_positions, chirp:"):
        StreamWriter.open(tmp_path / "scan.zarr", other, APERTURE, INPUTS, resume=True)


def test_an_unfinished_scan_is_neither_resumed_nor_discarded_unasked(tmp_path: Path) -> None:
    path = tmp_path / "scan.zarr"
    with start(path) as writer:
        writer.write(0, H[:2048])
    with pytest.raises(StoreError, match=r"is unfinished: go on with --resume .* or start anew with --force"):
        start(path)
    with start(path, overwrite=True, inputs=INPUTS | {"seed": 1}) as writer:
        assert len(writer.missing_blocks()) == 2


def test_a_finished_scan_is_replaced_on_request_only_and_in_the_end(
    tmp_path: Path, saved: dict[str, bytes]
) -> None:
    path = tmp_path / "scan.zarr"
    Measurement(H[:1], CHIRP, Aperture(APERTURE.tx_m[:1])).save(path)
    for resume in (False, True):
        with pytest.raises(StoreError, match=r"exists; pass --force"):
            start(path, resume=resume)
    with start(path, overwrite=True) as writer:
        writer.write(0, H[:2048])
    assert len(Measurement.load(path).h) == 1
    assert run(path, resume=True, overwrite=True) == 1
    assert files(path) == saved
    assert os.listdir(tmp_path) == ["scan.zarr"]


def test_a_power_cut_between_the_two_renames_loses_neither_scan(
    tmp_path: Path, saved: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, retired = tmp_path / "scan.zarr", tmp_path / ".scan.zarr.old"
    Measurement(H[:1], CHIRP, Aperture(APERTURE.tx_m[:1])).save(path)

    def cut(complete: Path, target: Path) -> None:
        target.rename(retired)
        raise PowerCut

    with monkeypatch.context() as patch, pytest.raises(PowerCut):
        patch.setattr("waveformer.simulator.stream_store.swap_in", cut)
        run(path, overwrite=True)
    assert len(Measurement.load(retired).h) == 1
    assert run(path, resume=True) == 0
    assert files(path) == saved


def test_foreign_data_are_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "scan.zarr").write_text("precious")
    with pytest.raises(StoreError, match="choose another path"):
        start(tmp_path / "scan.zarr", overwrite=True)
    with pytest.raises(StoreError):
        start(Path("/proc/scan.zarr"))


def test_two_writers_are_not_let_in(tmp_path: Path) -> None:
    path = tmp_path / "scan.zarr"
    with start(path), pytest.raises(StoreError, match=f"in use by process {os.getpid()}"):
        start(path, overwrite=True)
    start(path, resume=True).close()


@pytest.mark.parametrize("at", ["fsync", "replace"])
def test_a_full_disk_leaves_no_complete_looking_store(
    tmp_path: Path, saved: dict[str, bytes], monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    path = tmp_path / "scan.zarr"

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    with start(path) as writer:
        writer.write(0, H[:2048])
        with monkeypatch.context() as patch:
            patch.setattr(os, at, full) if at == "fsync" else patch.setattr(Path, at, full)
            with pytest.raises(StoreError, match=r"No space left on device; blocks .* kept.*--resume"):
                writer.write(2048, H[2048:])
        with pytest.raises(StoreError, match="1 of 2 blocks are missing"):
            writer.finish()
    with pytest.raises(StoreError, match="unfinished"):
        Measurement.load(path)
    assert run(path, resume=True) == 1
    assert files(path) == saved


def test_nonsense_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scan.zarr"
    with pytest.raises(StoreError, match="multiple of 1024"):
        StreamWriter.open(path, CHIRP, APERTURE, INPUTS, block_positions=1000)
    with pytest.raises(StoreError, match="JSON"):
        start(path, inputs={"mesh": object()})
    with start(path) as writer:
        writer.write(0, H[:2048])
        for first_row in (0, 1024, 4096):
            with pytest.raises(StoreError, match=f"no missing block starts at row {first_row}"):
                writer.write(first_row, H[:2048])
        with pytest.raises(StoreError, match=r"complex of shape \(1952, 8\), got complex64 \(2048, 8\)"):
            writer.write(2048, H[:2048])
        with pytest.raises(StoreError, match="got float32"):
            writer.write(2048, H[2048:].real)
