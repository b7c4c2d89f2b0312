"""What happens in a sandbox stays there: crashes, hangs, memory, prints; and it ends with its parent."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from waveformer.datagen.sandbox import Sandbox, SandboxError
from waveformer.simulator.errors import MeshError, SetupError

GIGABYTE = 1_000_000_000
JOBS = """
import ctypes, os, signal, sys, time
import numpy as np
from waveformer.simulator.errors import MeshError, WaveformerError

def work(what, *args):
    return globals()[what](*args)

def double(array):
    return 2 * array

def pid():
    return os.getpid()

def refuse():
    raise MeshError("mesh.empty", "cup.ply holds no faces")

def defect():
    raise ValueError("two\\nlines")

def leave():
    sys.exit(3)

def vanish():
    os._exit(7)

def crash():
    ctypes.string_at(0)

def killed():
    os.kill(os.getpid(), signal.SIGKILL)

def hang():
    while True:
        time.sleep(1)

def hang_in_a_library():
    ctypes.PyDLL(None).sleep(1000)  # PyDLL keeps the interpreter locked

def eat():
    return len(np.ones(4_000_000_000, dtype=np.uint8))

def unpicklable():
    return lambda: None

def chatter():
    print("to standard output")
    os.system("echo from a child process")
    return sys.stdin.read()

def threads():
    return os.environ["OMP_NUM_THREADS"]
"""


@pytest.fixture
def jobs(tmp_path, monkeypatch):
    (tmp_path / "sandbox_jobs.py").write_text(JOBS)
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.fixture
def sandbox(jobs):
    with Sandbox("sandbox_jobs:work", time_limit_s=20.0, memory_limit_bytes=2 * GIGABYTE) as box:
        yield box


def test_arrays_pass_there_and_back_quickly(sandbox):
    array = np.arange(1_000_000, dtype=np.float64)  # 8 MB
    np.testing.assert_array_equal(sandbox.call("double", array), 2 * array)
    started = time.perf_counter()
    for _ in range(5):
        sandbox.call("double", array)
    # Measured 0.02 s for a round trip of 16 MB; ten times that on a busy machine.
    assert (time.perf_counter() - started) / 5 < 0.2


def test_one_child_serves_many_calls(sandbox):
    assert sandbox.call("pid") == sandbox.call("pid") != os.getpid()
    assert sandbox.call("threads") == "1"


def test_an_expected_error_comes_back_whole_and_the_child_goes_on(sandbox):
    before = sandbox.call("pid")
    with pytest.raises(MeshError, match=r"^cup\.ply holds no faces$") as caught:
        sandbox.call("refuse")
    assert caught.value.code == "mesh.empty"
    assert sandbox.call("pid") == before


@pytest.mark.parametrize(
    ("job", "kind", "reason"),
    [
        ("defect", "error", "ValueError: two lines"),
        ("leave", "error", "SystemExit: 3"),
        ("unpicklable", "error", "pickle"),
        ("vanish", "died", "its process ended by itself (exit code 7)"),
        ("crash", "died", "its process was ended by SIGSEGV"),
        ("killed", "died", "its process was ended by SIGKILL, likely for lack of memory"),
        ("eat", "memory", "needed more than 2 GB of memory"),
    ],
)
def test_failures_are_one_line_and_the_next_call_works(sandbox, job, kind, reason):
    with pytest.raises(SandboxError) as caught:
        sandbox.call(job)
    assert caught.value.kind == kind
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(sandbox.call("double", np.ones(3)), 2 * np.ones(3))


@pytest.mark.parametrize("job", ["hang", "hang_in_a_library"])
def test_a_hang_is_stopped(jobs, job):
    with Sandbox("sandbox_jobs:work", time_limit_s=0.5, memory_limit_bytes=2 * GIGABYTE) as box:
        hung = box.call("pid")
        started = time.perf_counter()
        with pytest.raises(SandboxError, match=r"^stopped after 0\.5 s") as caught:
            box.call(job)
        assert time.perf_counter() - started < 5.0
        assert caught.value.kind == "timeout"
        assert not is_running(hung)
        assert box.call("pid") != hung


def test_killed_while_idle_costs_nobody_a_call(sandbox):
    before = sandbox.call("pid")
    os.kill(before, signal.SIGKILL)
    wait_until_gone(before)
    assert sandbox.call("pid") != before


def test_killed_during_a_call(sandbox):
    pid = sandbox.call("pid")
    threading.Timer(0.2, os.kill, (pid, signal.SIGKILL)).start()
    with pytest.raises(SandboxError, match="SIGKILL"):
        sandbox.call("hang")


def test_prints_do_not_reach_the_answers(sandbox, capfd):
    assert sandbox.call("chatter") == ""
    assert capfd.readouterr() == ("", "")


def test_an_interrupt_leaves_no_stale_answer(sandbox):
    sandbox.call("pid")
    previous = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        with pytest.raises(KeyboardInterrupt):
            sandbox.call("hang")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
    assert sandbox.call("threads") == "1"


def test_a_pickled_copy_has_its_own_process(sandbox):
    first = sandbox.call("pid")
    with pickle.loads(pickle.dumps(sandbox)) as copy:
        assert copy.call("pid") != first
    assert sandbox.call("pid") == first


@pytest.mark.parametrize("function", ["no_such_module:work", "sandbox_jobs:no_such_function"])
def test_a_wrong_name_is_told(jobs, function):
    with (
        Sandbox(function, time_limit_s=5.0, memory_limit_bytes=GIGABYTE) as box,
        pytest.raises(SetupError, match="cannot import"),
    ):
        box.call()


def test_kill_from_another_thread_ends_the_call(sandbox):
    sandbox.call("pid")
    threading.Timer(0.2, sandbox.kill).start()
    with pytest.raises(SandboxError, match="SIGKILL"):
        sandbox.call("hang")


def test_close_ends_the_child(sandbox):
    pid = sandbox.call("pid")
    sandbox.close()
    assert not is_running(pid)


@pytest.mark.parametrize("job", ["pid", "hang", "hang_in_a_library"])
def test_it_ends_with_its_parent_however_that_ends(jobs, tmp_path, job):
    code = f"""
import threading
from waveformer.datagen.sandbox import Sandbox
box = Sandbox("sandbox_jobs:work", time_limit_s=1000.0, memory_limit_bytes={2 * GIGABYTE})
print(box.call("pid"), flush=True)
box.call("{job}")
threading.Event().wait()
"""
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    parent = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": paths},
    )
    child = int(parent.stdout.readline())
    time.sleep(0.3)
    assert is_running(child)
    parent.kill()
    parent.communicate()
    wait_until_gone(child)


def is_running(pid):
    try:
        with open(f"/proc/{pid}/stat") as lines:
            return lines.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_until_gone(pid):
    deadline = time.monotonic() + 10.0
    while is_running(pid):
        assert time.monotonic() < deadline, "the child outlived its parent"
        time.sleep(0.02)


@pytest.mark.parametrize("name", ["WAVEFORMER_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"])
def test_a_child_has_one_thread_of_each_kind(monkeypatch, name):
    monkeypatch.setenv(name, "7")
    with Sandbox("os:getenv", time_limit_s=5.0, memory_limit_bytes=GIGABYTE) as box:
        assert box.call(name) == "1"


def test_a_child_keeps_its_memory_whatever_dask_wants_of_its_workers(monkeypatch):
    monkeypatch.setenv("MALLOC_TRIM_THRESHOLD_", "65536")
    with Sandbox("os:getenv", time_limit_s=5.0, memory_limit_bytes=GIGABYTE) as box:
        assert box.call("MALLOC_TRIM_THRESHOLD_") is None
