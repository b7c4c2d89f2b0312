"""A scan larger than memory: blocks of rows by worker processes, written as they come, resumed where they stopped.

Each worker has one Dr.Jit thread, so that a block has the same bytes whenever and wherever it is computed.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError, SetupError
from waveformer.simulator.forward_model import BLOCK_POSITIONS, ForwardModel, Progress
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.runtime import THREADS_VARIABLE
from waveformer.simulator.stream_store import StreamWriter

_model: ForwardModel | None = None


def simulate_to_store(
    targets: Any,
    chirp: Chirp,
    aperture: Aperture,
    path: str | os.PathLike[str],
    *,
    workers: int | None = None,
    overwrite: bool = False,
    resume: bool = False,
    metadata: dict[str, Any] | None = None,
    progress: Progress | None = None,
    **scene: Any,
) -> None:
    """`simulate`, written to a store block by block; `Measurement.load` reads it.

    The store has the same bytes whatever the number of workers and however often the run was interrupted.

    Args:
        targets, chirp, aperture: as in `simulate`.
        path: of the store.
        workers: processes, each with one thread; None takes as many as ``WAVEFORMER_THREADS`` says, else one a
            processor core that this process may use.
        overwrite: replace an existing store.
        resume: go on with an interrupted run of the same scene.
        metadata: JSON values kept with the scan.
        progress: called with (positions written, positions in all).
        scene: the other arguments of `simulate`, by name.

    Raises:
        WaveformerError: as `simulate`, and `StoreError` where the path may not be written, or the interrupted run
            was of another scene.
    """
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise RadarError(f"workers must be a whole number of at least 1, got {workers!r}")
    model = ForwardModel.prepare(
        targets, chirp, aperture, **scene
    )  # every refusal comes before the first block
    with StreamWriter.open(
        path,
        chirp,
        aperture,
        model.fingerprint(),
        block_positions=BLOCK_POSITIONS,
        overwrite=overwrite,
        resume=resume,
    ) as writer:
        missing = writer.missing_blocks()
        done = len(aperture) - sum(rows.stop - rows.start for rows in missing)
        arguments = pickle.dumps(replace(model, scene=None))
        for rows, h in _computed(arguments, missing, min(workers or _default_workers(), len(missing))):
            writer.write(rows.start, h)
            done += rows.stop - rows.start
            if progress is not None:
                progress(done, len(aperture))
        writer.finish(
            range_bias_m=model.front_end.range_bias_m, metadata={**model.describe(), **(metadata or {})}
        )


def _default_workers() -> int:
    if asked := os.environ.get(THREADS_VARIABLE, ""):
        return max(1, int(asked)) if asked.isdigit() else 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _computed(
    arguments: bytes, blocks: list[slice], workers: int
) -> Iterator[tuple[slice, NDArray[np.complex64]]]:
    """Blocks as they are ready; only one a worker waits, so that memory stays bounded."""
    if not blocks:
        return
    pool = ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(arguments,)
    )
    with pool:
        reference = pool.submit(_reference_power).result()
        waiting: dict[Future[NDArray[np.complex64]], slice] = {}
        left = list(reversed(blocks))
        try:
            while left or waiting:
                while left and len(waiting) < workers + 1:
                    rows = left.pop()
                    waiting[pool.submit(_record, rows, reference)] = rows
                for ready in wait(waiting, return_when=FIRST_COMPLETED).done:
                    yield waiting.pop(ready), ready.result()
        except BrokenProcessPool as error:
            raise SetupError(
                "a worker process died, likely for lack of memory: run again with --resume and fewer workers"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _begin(arguments: bytes) -> None:
    """In a worker: one thread, and the scene."""
    global _model
    threading.Thread(target=_end_with_parent, daemon=True).start()
    os.environ[THREADS_VARIABLE] = "1"
    _model = pickle.loads(arguments).traced()  # made by the parent process


def _end_with_parent() -> None:
    """A parent killed outright cannot stop its workers."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _reference_power() -> float | None:
    assert _model is not None
    return _model.reference_power()


def _record(rows: slice, reference_power: float | None) -> NDArray[np.complex64]:
    assert _model is not None
    return _model.record(rows, reference_power)
