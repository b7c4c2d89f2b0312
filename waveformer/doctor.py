"""Checks of the machine, each in a child process, so that an abort or a crash there becomes a row of the report."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any

from waveformer.probes import FAIL, OK, WARN
from waveformer.simulator.runtime import ATOMIC_REMEDY, CUDA_REMEDY, DEVICE_VARIABLE, LLVM_REMEDY, VARIANTS

TIMEOUT_S = 300.0


@dataclass(frozen=True)
class Check:
    """One thing to try.

    Attributes:
        name: first column of the report.
        code: Python code for the child process; its last line of output is a JSON object with the keys
            ``status`` and ``found``.
        remedy: the exact command, or what to do, if it does not work.
        is_optional: a failure is only a warning.
    """

    name: str
    code: str
    remedy: str
    is_optional: bool = False


@dataclass(frozen=True)
class Row:
    """The outcome of one check.

    Attributes:
        name: the check.
        status: "ok", "warn" or "fail".
        found: what was found.
        remedy: what to do; empty if all is well.
    """

    name: str
    status: str
    found: str
    remedy: str


def _probe(name: str, remedy: str, *, is_optional: bool = False) -> Check:
    return Check(name, f"from waveformer.probes import report; report({name!r})", remedy, is_optional)


def _packages_remedy() -> str:
    return f"{sys.executable} -m pip install -c constraints.txt -e '.[dev]'   (in the repository; or: make setup)"


def standard_checks() -> list[Check]:
    """The checks of `waveformer doctor`, in the order of the report."""
    packages = _packages_remedy()
    return [
        _probe("python", "apt-get install -y python3 python3-venv   (3.11 or newer), then: make setup"),
        _probe("libatomic", ATOMIC_REMEDY),
        _probe("libllvm", LLVM_REMEDY),
        _probe("device", f"set {DEVICE_VARIABLE} to {' or '.join(VARIANTS)}; for cuda {CUDA_REMEDY}"),
        _probe("mitsuba", f"repair the rows above first; then: {packages}"),
        _probe("gpu", "nothing to do: torch runs on the CPU too", is_optional=True),
        _probe("torch", packages),
        _probe("pyvista", "apt-get install -y --no-install-recommends libgl1 libegl1"),
        _probe("zarr", f"{packages}; TMPDIR must be writable"),
        _probe("disk", "free some disk space: datasets and meshes need several GB"),
        _probe("threads", "unset WAVEFORMER_THREADS, or set it to a positive integer"),
        _probe("memory", "close other programs, or simulate fewer positions at a time"),
    ]


def run_check(check: Check, timeout_s: float = TIMEOUT_S) -> Row:
    """Run one check in a child process; never raises for what happens in there."""
    try:
        child = subprocess.run(
            [sys.executable, "-c", check.code],
            check=False,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout_s,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return _failure(check, f"no answer within {timeout_s:g} s")
    answer = _last_json_object(child.stdout)
    # A crash at exit, after the answer, would hit every program as well: it counts.
    if child.returncode != 0 or answer is None:
        return _failure(check, _how_it_ended(child.returncode, child.stderr))
    status, found = str(answer["status"]), str(answer["found"])
    if status == FAIL:
        return _failure(check, found)
    return Row(check.name, status, found, "" if status == OK else check.remedy)


def run_checks(checks: Sequence[Check] | None = None, workers: int = 2) -> list[Row]:
    """Run the checks, a few at a time, and return their rows in the order given."""
    with ThreadPoolExecutor(max_workers=workers) as pool:
        return list(pool.map(run_check, standard_checks() if checks is None else checks))


def as_json(rows: Sequence[Row]) -> str:
    """The report for machines: ``{"ok": bool, "checks": [{name, status, found, remedy}, ...]}``."""
    return json.dumps({"ok": is_healthy(rows), "checks": [asdict(row) for row in rows]}, indent=2)


def is_healthy(rows: Sequence[Row]) -> bool:
    """True if no check failed; warnings are allowed."""
    return all(row.status != FAIL for row in rows)


def _failure(check: Check, found: str) -> Row:
    return Row(check.name, WARN if check.is_optional else FAIL, found, check.remedy)


def _last_json_object(output: str) -> dict[str, Any] | None:
    lines = output.strip().splitlines()
    try:
        answer = json.loads(lines[-1]) if lines else None
    except ValueError:
        return None
    return answer if isinstance(answer, dict) and {"status", "found"} <= answer.keys() else None


def _how_it_ended(return_code: int, stderr: str) -> str:
    if return_code < 0:
        try:
            ending = f"the process was killed by {signal.Signals(-return_code).name}"
        except ValueError:
            ending = f"the process was killed by signal {-return_code}"
    else:
        ending = f"the process ended with exit code {return_code} and no answer"
    lines = stderr.strip().splitlines()
    return f"{ending}: {lines[-1].strip()[:200]}" if lines else ending
