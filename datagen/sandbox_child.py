"""The process inside a `Sandbox`: reads calls from its standard input, answers them on its standard output.

Run as ``python -m waveformer.datagen.sandbox_child MODULE:FUNCTION MEMORY_BYTES LIFELINE``. LIFELINE is the
reading end of a pipe that the parent holds open and never writes to: it hangs up when the parent is gone, by
whatever cause, and the kernel then ends this process, even in the middle of a call into a library.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib
import os
import pickle
import select
import sys
from collections.abc import Callable
from typing import Any, BinaryIO

from waveformer.simulator.errors import WaveformerError

_HEADER_BYTES = 8


def main(function: str, memory_limit_bytes: int, lifeline: int) -> None:
    """Answer calls until the parent ends."""
    _end_with(lifeline)
    requests, answers = _private_streams()
    _limit_memory(memory_limit_bytes)
    module, name = function.split(":")
    try:
        target: Callable[..., Any] = getattr(importlib.import_module(module), name)
    except MemoryError:
        limit = f"{memory_limit_bytes / 1e9:g} GB"
        _answer(answers, "error", f"cannot import {function} within {limit} of memory: allow more")
        return
    except Exception as error:  # noqa: BLE001 (whatever a module may raise)
        _answer(answers, "error", f"cannot import {function}: {_describe(error)}")
        return
    _answer(answers, "ready", None)
    while header := requests.read(_HEADER_BYTES):
        _answer_call(answers, target, requests.read(int.from_bytes(header, "little")))


def _answer_call(answers: BinaryIO, target: Callable[..., Any], request: bytes) -> None:
    try:
        arguments = pickle.loads(request)
        _answer(answers, "result", target(*arguments))
    except WaveformerError as error:
        _answer(answers, "raise", (type(error), error.args, error.__dict__))
    except MemoryError:
        _answer(answers, "memory", None)
    except BaseException as error:  # noqa: BLE001 (SystemExit of a library too)
        _answer(answers, "error", _describe(error))


def _answer(answers: BinaryIO, kind: str, content: Any) -> None:
    body = pickle.dumps((kind, content), protocol=5)
    answers.write(len(body).to_bytes(_HEADER_BYTES, "little"))
    answers.write(body)
    answers.flush()


def _end_with(lifeline: int) -> None:
    """Have the kernel end this process (the default of SIGIO) as soon as the lifeline hangs up."""
    fcntl.fcntl(lifeline, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)
    poller = select.poll()
    poller.register(lifeline, select.POLLIN)
    if poller.poll(0):  # hung up before the kernel was asked to watch
        os._exit(1)


def _private_streams() -> tuple[BinaryIO, BinaryIO]:
    """The pipes of the parent, out of the reach of libraries that print or ask."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    os.close(nothing)
    return requests, answers


def _limit_memory(limit_bytes: int) -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (limit_bytes, limit_bytes))


def _describe(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}"[:300] if text else type(error).__name__


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
