"""Jobs in worker processes of one thread each, stopped at once when the user says so."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from waveformer.simulator.errors import SetupError
from waveformer.simulator.runtime import THREADS_VARIABLE, activate

Job = TypeVar("Job")
Result = TypeVar("Result")


def default_workers() -> int:
    """``WAVEFORMER_THREADS`` if set, else one a processor core that this process may use."""
    asked = os.environ.get(THREADS_VARIABLE, "")
    if asked.isdecimal():
        return max(1, int(asked))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_jobs(work: Callable[[Job], Result], jobs: Sequence[Job], workers: int) -> Iterator[Result]:
    """Results as they are ready; each job in one thread, so that it has the same bytes wherever it runs.

    Args:
        work: a function of a module; it and the jobs must be picklable.
        jobs: what to do.
        workers: processes; one works in this process.

    Raises:
        SetupError: a process died.
    """
    workers = min(workers, len(jobs))
    if workers <= 1:
        if jobs:
            activate(num_threads=1)
        yield from map(work, jobs)
        return
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    pool = ProcessPoolExecutor(workers, context, initializer=_begin, initargs=(stop,))
    try:
        for ready in as_completed([pool.submit(work, job) for job in jobs]):
            yield ready.result()
    except BrokenProcessPool as error:
        raise SetupError(
            "a worker process died, likely for lack of memory: run the same command again with fewer workers"
        ) from error
    except BaseException:  # Ctrl-C too: nobody shall finish a job of minutes
        stop.set()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin(stop: Any) -> None:
    """In a worker: one thread; Ctrl-C is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_when, args=(stop.wait,), daemon=True).start()
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=_end_when, args=(parent.join,), daemon=True).start()
    activate(num_threads=1)


def _end_when(happens: Callable[[], Any]) -> None:
    happens()
    while True:  # the first may end a job only, after what it had half-written is removed
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1.0)
