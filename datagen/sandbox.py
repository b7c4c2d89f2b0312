"""A function called in a child process, so that what crashes, hangs or eats memory there ends there.

The child is an ordinary Python process (`sandbox_child`), started at the first call, kept for the next ones and
replaced after it died or was stopped. It is no child of multiprocessing, so daemonic workers may use it too.
"""

from __future__ import annotations

import contextlib
import math
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
import time
from types import TracebackType
from typing import Any, Literal, Self

from waveformer.simulator.errors import SetupError, WaveformerError

_START_LIMIT_S = 120.0  # for the imports of the function's module, on a busy machine
_HEADER_BYTES = 8
_BLOCK_BYTES = 1 << 20
# One thread gives the same bits every time, and none waits for the threads of another worker.
_THREAD_COUNTS = ("WAVEFORMER_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
# Dask has its workers hand memory back at every turn. Here the next sample needs it again, and fetching it anew from
# the system costs 40 % more time.
_HAND_MEMORY_BACK = "MALLOC_TRIM_THRESHOLD_"


class SandboxError(WaveformerError):
    """A call ended without a result.

    Attributes:
        kind: "died" (the process ended by itself or was killed), "timeout", "memory", or "error": the function
            raised something else than a WaveformerError.
    """

    def __init__(self, kind: Literal["died", "timeout", "memory", "error"], message: str) -> None:
        super().__init__(message)
        self.kind = kind


class Sandbox:
    """One function in one child process with one thread; a context manager.

    Args:
        function: "module:name" of a function whose arguments and results can be pickled.
        time_limit_s: for one call; the start of the child has its own limit of two minutes.
        memory_limit_bytes: address space of the child, its libraries included (NumPy, SciPy and trimesh: 0.5 GB);
            without effect where the system knows no such limit.

    A copy, pickled or forked, shares no process with its original.
    """

    def __init__(self, function: str, *, time_limit_s: float, memory_limit_bytes: int) -> None:
        self.function = function
        self.time_limit_s = time_limit_s
        self.memory_limit_bytes = memory_limit_bytes
        self._lock = threading.Lock()
        self._child: subprocess.Popen[bytes] | None = None
        self._lifeline: int | None = None
        self._owner_pid = os.getpid()

    def call(self, *args: Any) -> Any:
        """What the function returns.

        Raises:
            SandboxError: no result; the next call has a fresh child.
            SetupError: the function cannot be imported within the limits.
            WaveformerError: as the function raised it, with its attributes.
        """
        with self._lock:
            try:
                child = self._ready_child()
                deadline = time.monotonic() + self.time_limit_s
                _send(child, args, deadline)
                kind, content = _receive(child, deadline)
            except TimeoutError:
                self._stop()
                raise SandboxError(
                    "timeout", f"stopped after {self.time_limit_s:g} s without a result"
                ) from None
            except (EOFError, BrokenPipeError):
                raise SandboxError("died", self._obituary()) from None
            except BaseException:  # Ctrl-C: an answer to this call must never be taken for one to the next
                self._stop()
                raise
            if kind == "memory":
                self._stop()  # what it could not free would be missing in the next call
                raise SandboxError(
                    "memory", f"needed more than {self.memory_limit_bytes / 1e9:g} GB of memory"
                )
        if kind == "error":
            raise SandboxError("error", content)
        if kind == "raise":
            error_class, error_args, attributes = content
            error = error_class.__new__(error_class, *error_args)
            error.__dict__.update(attributes)
            raise error
        return content

    def close(self) -> None:
        """End the child; a later call starts another."""
        with self._lock:
            self._stop()

    def kill(self) -> None:
        """End a call that runs in another thread: there it raises SandboxError "died"."""
        child = self._child
        if child is not None and self._owner_pid == os.getpid() and child.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child.pid, signal.SIGKILL)

    def _ready_child(self) -> subprocess.Popen[bytes]:
        if self._owner_pid != os.getpid():
            if self._lifeline is not None:
                os.close(self._lifeline)  # or the child of the original would live as long as this fork
            self._child = None
            self._lifeline = None
            self._owner_pid = os.getpid()
        if self._child is not None and self._child.poll() is None:
            return self._child
        self._stop()
        child_end, self._lifeline = os.pipe()
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        environment = {**os.environ, **dict.fromkeys(_THREAD_COUNTS, "1"), "PYTHONPATH": paths}
        environment.pop(_HAND_MEMORY_BACK, None)
        arguments = (self.function, str(self.memory_limit_bytes), str(child_end))
        try:
            self._child = subprocess.Popen(
                [sys.executable, "-P", "-m", "waveformer.datagen.sandbox_child", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
                pass_fds=(child_end,),
                start_new_session=True,  # Ctrl-C in the terminal is for this process alone
                env=environment,
            )
        finally:
            os.close(child_end)
        assert self._child.stdin is not None
        os.set_blocking(self._child.stdin.fileno(), False)
        try:
            kind, content = _receive(self._child, time.monotonic() + _START_LIMIT_S)
        except TimeoutError:
            self._stop()
            raise SetupError(f"{self.function} was not imported within {_START_LIMIT_S:g} s") from None
        if kind != "ready":
            self._stop()
            raise SetupError(content)
        return self._child

    def _obituary(self) -> str:
        code = None
        if self._child is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = self._child.wait(timeout=5.0)
        self._stop()
        if code is None or code >= 0:
            return f"its process ended by itself (exit code {code})"
        try:
            name = signal.Signals(-code).name
        except ValueError:
            name = f"signal {-code}"
        hint = ", likely for lack of memory" if -code == signal.SIGKILL else ""
        return f"its process was ended by {name}{hint}"

    def _stop(self) -> None:
        if self._child is not None and self._owner_pid == os.getpid():
            if self._child.poll() is None:
                os.killpg(self._child.pid, signal.SIGKILL)  # with what it may have started itself
            self._child.wait()
            for stream in (self._child.stdin, self._child.stdout):
                assert stream is not None
                stream.close()
        if self._lifeline is not None:
            os.close(self._lifeline)
        self._child = None
        self._lifeline = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if getattr(self, "_owner_pid", None) == os.getpid():
            self._stop()

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self.function, self.time_limit_s, self.memory_limit_bytes)


def _restore(function: str, time_limit_s: float, memory_limit_bytes: int) -> Sandbox:
    return Sandbox(function, time_limit_s=time_limit_s, memory_limit_bytes=memory_limit_bytes)


def _send(child: subprocess.Popen[bytes], content: Any, deadline: float) -> None:
    assert child.stdin is not None
    body = pickle.dumps(content, protocol=5)
    for part in (len(body).to_bytes(_HEADER_BYTES, "little"), body):
        left = memoryview(part)
        while left:
            _wait(child.stdin.fileno(), select.POLLOUT, deadline)
            left = left[os.write(child.stdin.fileno(), left[:_BLOCK_BYTES]) :]


def _receive(child: subprocess.Popen[bytes], deadline: float) -> tuple[Any, Any]:
    size = int.from_bytes(_read(child, _HEADER_BYTES, deadline), "little")
    answer: tuple[Any, Any] = pickle.loads(_read(child, size, deadline))
    return answer


def _read(child: subprocess.Popen[bytes], size: int, deadline: float) -> bytearray:
    assert child.stdout is not None
    data = bytearray(size)
    left = memoryview(data)
    while left:
        _wait(child.stdout.fileno(), select.POLLIN, deadline)
        count = os.readv(child.stdout.fileno(), [left[:_BLOCK_BYTES]])
        if count == 0:
            raise EOFError
        left = left[count:]
    return data


def _wait(descriptor: int, event: int, deadline: float) -> None:
    poller = select.poll()
    poller.register(descriptor, event)
    left_s = deadline - time.monotonic()
    if left_s <= 0 or not poller.poll(math.ceil(left_s * 1e3)):
        raise TimeoutError
