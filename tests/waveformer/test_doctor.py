"""The report of the machine: above all, that a crash inside a check becomes a row and nothing worse."""

from __future__ import annotations

import json
import os

import pytest

from waveformer.doctor import Check, Row, as_json, is_healthy, run_check, run_checks, standard_checks
from waveformer.probes import PROBES

GOOD = Check("good", """print('noise'); print('{"status": "ok", "found": "all well"}')""", "none needed")


def test_a_good_check_needs_no_remedy():
    assert run_check(GOOD) == Row("good", "ok", "all well", "")


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("import os; os.abort()", "killed by SIGABRT"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "killed by SIGSEGV"),
        ("raise SystemExit(3)", "exit code 3"),
        ("import absent_package", "No module named 'absent_package'"),
        ("print('not json')", "no answer"),
        (
            """print('{"status": "ok", "found": "x"}', flush=True); import os; os.abort()""",
            "killed by SIGABRT",
        ),
    ],
)
def test_what_goes_wrong_in_the_child_is_reported(code, found):
    row = run_check(Check("broken", code, "mend it"))
    assert row.status == "fail"
    assert found in row.found
    assert row.remedy == "mend it"


def test_a_hanging_check_ends():
    row = run_check(Check("slow", "import time; time.sleep(60)", "wait less"), timeout_s=0.5)
    assert row.status == "fail"
    assert "no answer within 0.5 s" in row.found


def test_an_optional_check_only_warns():
    row = run_check(Check("gpu", "import os; os.abort()", "nothing", is_optional=True))
    assert (row.status, "SIGABRT" in row.found) == ("warn", True)


def test_rows_keep_their_order_and_one_failure_spoils_the_report():
    rows = run_checks([GOOD, Check("broken", "import os; os.abort()", "mend it"), GOOD])
    assert [row.status for row in rows] == ["ok", "fail", "ok"]
    assert not is_healthy(rows)
    assert is_healthy([Row("disk", "warn", "little space", "free some")])


def test_json():
    report = json.loads(as_json(run_checks([GOOD])))
    assert report == {
        "ok": True,
        "checks": [{"name": "good", "status": "ok", "found": "all well", "remedy": ""}],
    }


def test_every_check_has_a_probe_and_a_remedy():
    checks = standard_checks()
    assert [check.name for check in checks] == list(PROBES)
    assert all(check.remedy for check in checks)


def test_an_llvm_that_aborts_is_named_with_its_remedy(tmp_path, monkeypatch):
    library = tmp_path / "libLLVM-15.so.1"
    library.touch()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(library))
    check = next(check for check in standard_checks() if check.name == "libllvm")
    row = run_check(check)
    assert row.status == "fail"
    assert "LLVM 15" in row.found
    assert "libllvm19" in row.remedy


@pytest.mark.parametrize("name", ["python", "libatomic", "libllvm", "device", "mitsuba", "zarr", "threads"])
def test_this_machine(name):
    check = next(check for check in standard_checks() if check.name == name)
    row = run_check(check)
    assert row.status == "ok", row


def test_a_bad_thread_limit(monkeypatch):
    monkeypatch.setitem(os.environ, "WAVEFORMER_THREADS", "many")
    check = next(check for check in standard_checks() if check.name == "threads")
    assert run_check(check).status == "fail"


def test_the_device_in_use_is_named(monkeypatch):
    check = next(check for check in standard_checks() if check.name == "device")
    monkeypatch.delenv("WAVEFORMER_DEVICE", raising=False)
    assert run_check(check).found.startswith("cpu (the default); CUDA ")
    monkeypatch.setenv("WAVEFORMER_DEVICE", "cuda")
    row = run_check(check)
    assert row.found.startswith("cuda (by WAVEFORMER_DEVICE); CUDA ")
    assert (row.status == "fail") == ("not possible" in row.found)
    monkeypatch.setenv("WAVEFORMER_DEVICE", "tpu")
    assert run_check(check).found == "WAVEFORMER_DEVICE must be cpu or cuda, got 'tpu'"


def test_libllvm_is_looked_at_whatever_the_device(monkeypatch):
    monkeypatch.setenv("WAVEFORMER_DEVICE", "cuda")
    check = next(check for check in standard_checks() if check.name == "libllvm")
    assert run_check(check).status == "ok"
