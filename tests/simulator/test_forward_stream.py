"""A streamed scan is the scan that `simulate` makes, also after a kill in the middle."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from waveformer.simulator import Aperture, Box, Chirp, FrontEnd, Measurement, StoreError, primitives, simulate
from waveformer.simulator.errors import RadarError
from waveformer.simulator.forward_model import BLOCK_POSITIONS
from waveformer.simulator.forward_stream import simulate_to_store
from waveformer.simulator.storage import unfinished_folder

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77.5001e9, 3.0009e9, 16)
# three blocks, the last one short
APERTURE = Aperture.planar_grid(128, 300, 0.001)
FRONT_END = FrontEnd(mirror_snr_db=40.0, row_depth_error_m=2e-4, range_bias_m=0.15)

PROGRAM = """
import sys
from waveformer.simulator import primitives
from tests.simulator.test_forward_stream import APERTURE, CHIRP, FRONT_END, ball
from waveformer.simulator.forward_stream import simulate_to_store

if __name__ == "__main__":
    simulate_to_store(ball(), CHIRP, APERTURE, sys.argv[1], workers=1, front_end=FRONT_END, resume=True)
"""


def ball():
    mesh = primitives.sphere(0.02, 0.002)
    mesh.apply_translation([0.01, 0.0, -0.3])
    return mesh


def wait_for_the_workers_to_end(group: int) -> None:
    for _ in range(200):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise AssertionError("workers outlive their parent")


def bytes_of(store: Path) -> dict[str, str]:
    files = sorted(path for path in store.rglob("*") if path.is_file())
    return {str(path.relative_to(store)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def test_a_streamed_scan_equals_the_one_in_memory(tmp_path: Path) -> None:
    assert len(APERTURE) > 2 * BLOCK_POSITIONS
    done: list[tuple[int, int]] = []
    simulate_to_store(
        ball(), CHIRP, APERTURE, tmp_path / "scan.zarr", workers=2, front_end=FRONT_END, metadata={"note": 1},
        progress=lambda *counts: done.append(counts),
    )  # fmt: skip
    stored = Measurement.load(tmp_path / "scan.zarr")
    whole = simulate(ball(), CHIRP, APERTURE, front_end=FRONT_END)
    # one thread a worker against all threads here: rounding only, as documented
    assert np.linalg.norm(stored.h - whole.h) < 1e-5 * np.linalg.norm(whole.h)
    assert stored.range_bias_m == whole.range_bias_m == 0.15
    assert stored.metadata["note"] == 1
    assert stored.metadata["front_end"] == whole.metadata["front_end"]
    assert done[-1] == (len(APERTURE), len(APERTURE))


def test_killed_in_the_middle_and_resumed_it_has_the_same_bytes(tmp_path: Path) -> None:
    program = tmp_path / "run.py"
    program.write_text(PROGRAM)
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, str(program)]
    subprocess.run([*command, str(tmp_path / "whole.zarr")], env=environment, check=True)

    path = tmp_path / "killed.zarr"
    journal = unfinished_folder(path) / "journal.jsonl"
    process = subprocess.Popen([*command, str(path)], env=environment, start_new_session=True)
    while not (journal.exists() and journal.read_text().count("\n") >= 1):
        assert process.poll() is None, "it ended before it could be killed"
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    wait_for_the_workers_to_end(process.pid)
    assert not path.exists()
    with pytest.raises(StoreError, match="--resume"):
        Measurement.load(path)
    written = journal.read_text().count("\n")
    assert 1 <= written < 3

    simulate_to_store(ball(), CHIRP, APERTURE, path, workers=2, front_end=FRONT_END, resume=True)
    assert bytes_of(path) == bytes_of(tmp_path / "whole.zarr")


def test_another_scene_does_not_go_on_with_an_interrupted_scan(tmp_path: Path) -> None:
    class Stop(Exception):
        pass

    def stop(_done: int, _total: int) -> None:
        raise Stop

    path = tmp_path / "scan.zarr"
    with pytest.raises(Stop):
        simulate_to_store(ball(), CHIRP, APERTURE, path, workers=1, front_end=FRONT_END, progress=stop)
    box = Box((-0.1, -0.1, -0.4), (0.1, 0.1, -0.2), 0.004, "cardboard")
    for other, name in (
        ({"seed": 1}, "seed"),
        ({"box": box}, "surroundings"),
        ({"front_end": None}, "front_end"),
    ):
        with pytest.raises(StoreError, match=f"different .*{name}"):
            simulate_to_store(ball(), CHIRP, APERTURE, path, resume=True, **{"front_end": FRONT_END, **other})


def test_refusals_come_before_anything_is_written(tmp_path: Path) -> None:
    behind = ball()
    behind.apply_translation([0, 0, 1])
    with pytest.raises(Exception, match="behind the aperture"):
        simulate_to_store(behind, CHIRP, APERTURE, tmp_path / "scan.zarr")
    with pytest.raises(RadarError, match="workers"):
        simulate_to_store(ball(), CHIRP, APERTURE, tmp_path / "scan.zarr", workers=0)
    assert list(tmp_path.iterdir()) == []
