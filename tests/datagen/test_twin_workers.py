"""Jobs in worker processes."""

import signal
import subprocess
import sys
import time

import pytest

from waveformer.datagen.twin_workers import default_workers, run_jobs
from waveformer.simulator.runtime import THREADS_VARIABLE

SCRIPT = """
import sys
from pathlib import Path
import trimesh
from waveformer.datagen.twin_conditions import resolve_conditions
from waveformer.datagen.twin_objects import find_objects
from waveformer.datagen.twin_run import run_twin
from waveformer.datagen.twin_settings import TwinSettings

def show(state):
    print(state.done, flush=True)

if __name__ == "__main__":
    root, num = Path(sys.argv[1]), int(sys.argv[2])
    settings = TwinSettings(num_x=num, num_y=num)
    run_twin(root / "twin", find_objects([root / "meshes"]), resolve_conditions(["clean", "rows"]), settings,
             workers=2, progress=show)
"""


def test_default_workers(monkeypatch):
    monkeypatch.setenv(THREADS_VARIABLE, "3")
    assert default_workers() == 3
    monkeypatch.delenv(THREADS_VARIABLE)
    assert default_workers() >= 1


def test_one_worker_is_this_process(mitsuba_variant):
    done = []
    assert list(run_jobs(done.append, [1, 2], workers=1)) == [None, None]
    assert done == [1, 2]
    assert list(run_jobs(done.append, [], workers=4)) == []


@pytest.fixture
def folder(tmp_path):
    import trimesh

    (tmp_path / "meshes").mkdir()
    for name in ("a", "b"):
        trimesh.creation.icosphere(subdivisions=5, radius=0.04).export(tmp_path / "meshes" / f"{name}.ply")
    (tmp_path / "twin.py").write_text(SCRIPT)
    return tmp_path


@pytest.mark.slow
def test_workers_make_the_same_bytes(folder, mitsuba_variant):
    from waveformer.datagen.twin_conditions import resolve_conditions
    from waveformer.datagen.twin_objects import find_objects
    from waveformer.datagen.twin_run import run_twin
    from waveformer.datagen.twin_settings import TwinSettings
    from waveformer.datagen.twin_store import twin_scans

    subprocess.run([sys.executable, "twin.py", ".", "4"], cwd=folder, check=True)
    alone = folder / "alone"
    objects, conditions = find_objects([folder / "meshes"]), resolve_conditions(["clean", "rows"])
    run_twin(alone, objects, conditions, TwinSettings(num_x=4, num_y=4), workers=1)
    pairs = list(zip(twin_scans(folder / "twin"), twin_scans(alone), strict=True))
    assert len(pairs) == 4
    for first, second in pairs:
        assert (first.measurement().h == second.measurement().h).all()


@pytest.mark.slow
def test_ctrl_c_ends_all_at_once(folder):
    # a job of 60 x 60 positions takes far longer than the test waits
    process = subprocess.Popen(
        [sys.executable, "twin.py", ".", "60"], cwd=folder, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "0"
    time.sleep(4.0)  # into the jobs
    process.send_signal(signal.SIGINT)
    process.wait(timeout=5.0)
    assert process.returncode != 0
    left = [path.name for path in (folder / "twin").rglob("*") if path.is_file()]
    assert sorted(left) == [".lock", "twin.json"]
