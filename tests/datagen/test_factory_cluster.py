"""The factory on Dask: workers that are killed, and a cluster of separate processes; the same bytes in the end."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import dask
import distributed
import psutil
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from factory_support import HERE, digests, made_dataset, new_dataset, start_run

from waveformer.datagen import factory_cluster
from waveformer.datagen.dataset_audit import audit, sweep
from waveformer.datagen.factory_run import run_factory
from waveformer.simulator.errors import SetupError

SAMPLES = 120


@pytest.fixture(autouse=True)
def makers_can_be_imported(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))


@pytest.fixture
def undisturbed(tmp_path):
    return digests(made_dataset(tmp_path / "whole", SAMPLES, "slow"))


def workers_of(process):
    """Dask's worker processes below a process: those that run tasks, not their nannies."""
    found = []
    for child in psutil.Process(process.pid).children(recursive=True):
        try:
            if "spawn_main" in " ".join(child.cmdline()):
                found.append(child)
        except psutil.Error:
            pass
    return found


@pytest.mark.slow
def test_killed_workers_are_replaced_and_nothing_is_lost(tmp_path, undisturbed, rng):
    root = new_dataset(tmp_path / "store", SAMPLES, "slow")
    run = start_run(root, workers=2)
    kills = 0
    while run.poll() is None and kills < 10:
        workers = workers_of(run)
        if audit(root).committed and workers:
            workers[rng.integers(len(workers))].kill()
            kills += 1
        time.sleep(float(rng.uniform(0.2, 0.8)))
    out, err = run.communicate(timeout=300)
    assert run.returncode == 0, err
    print(f"{kills} workers killed: {out.strip()}")
    assert kills == 10, "the run ended too early to be disturbed"
    assert out.strip() == f"{SAMPLES} requested = {SAMPLES} committed + 0 quarantined + 0 pending"
    sweep(root)
    assert not audit(root).damaged and digests(root) == undisturbed


@pytest.mark.slow
def test_a_cluster_of_separate_processes_with_one_killed(tmp_path, undisturbed):
    """Scheduler and three workers through Dask's own commands."""
    root = new_dataset(tmp_path / "store", SAMPLES, "slow")
    dask = [sys.executable, "-m", "dask"]
    processes = [
        subprocess.Popen(
            [*dask, "scheduler", "--port", "0", "--no-dashboard", "--host", "127.0.0.1"],
            stderr=subprocess.PIPE,
            text=True,
        )
    ]
    try:
        address = next(
            found[0] for line in processes[0].stderr if (found := re.findall(r"tcp://127\.0\.0\.1:\d+", line))
        )
        for _ in range(3):
            arguments = [address, "--nthreads", "1", "--no-dashboard", "--local-directory", str(tmp_path)]
            processes.append(
                subprocess.Popen(
                    [*dask, "worker", *arguments], stderr=subprocess.DEVNULL, start_new_session=True
                )
            )
        killed = False

        def kill_one(state):
            nonlocal killed
            if state.written and not killed:
                os.killpg(processes[1].pid, signal.SIGKILL)
                killed = True

        state = run_factory(root, scheduler=address, progress=kill_one)
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert killed and (state.committed, state.pending) == (SAMPLES, 0)
    sweep(root)
    assert not audit(root).damaged and digests(root) == undisturbed


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(factory_cluster, "_ANSWER_WITHIN", "2s")
    root = new_dataset(tmp_path / "store", 4)
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),
        pytest.raises(SetupError, match="does not answer"),
    ):
        run_factory(root, scheduler="tcp://127.0.0.1:9")


@pytest.mark.filterwarnings("error:Port")
def test_two_runs_side_by_side_warn_of_nothing_and_their_workers_are_not_profiled():
    with ExitStack() as stack:
        clients = [
            stack.enter_context(factory_cluster._client(distributed, stack, 1, None)) for _ in range(2)
        ]
        for client in clients:
            watched = client.run(dask.config.get, "distributed.worker.profile.enabled")
            assert list(watched.values()) == [False]
