"""Which libLLVM is chosen, and what is said when none will do. Files are empty: only names decide."""

from __future__ import annotations

import subprocess
import sys

import pytest

from waveformer.simulator import runtime
from waveformer.simulator.errors import SetupError


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A machine with nothing but the given library files: machine("libLLVM-15.so.1", ...)."""
    monkeypatch.delenv(runtime.LIBRARY_PATH_VARIABLE, raising=False)

    def _machine(*names: str):
        monkeypatch.setattr(runtime, "search_directories", lambda: iter([tmp_path]))
        for name in names:
            (tmp_path / name).touch()
        return tmp_path

    return _machine


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (["libLLVM-14.so.1", "libLLVM-15.so.1", "libLLVM.so.19.1"], "libLLVM.so.19.1"),
        (["libLLVM-17.so.1", "libLLVM.so.18.1"], "libLLVM.so.18.1"),
        (["libLLVM.so.20.1", "libLLVM.so.19.1", "libLLVM-17.so.1"], "libLLVM.so.19.1"),
        (["libLLVM.so.20.1", "libLLVM.so.18.1"], "libLLVM.so.20.1"),
        (["libLLVM-19.so"], "libLLVM-19.so"),
        (["libLLVM.so.19.1-1"], None),
        (["libLLVM-14.0.6.so.1", "libLLVM-16.so.1"], None),
        (["libLLVMSupport.a", "libLLVM-19.so.txt", "libLLVMgold.so"], None),
        ([], None),
    ],
)
def test_order_of_preference(machine, names, chosen):
    folder = machine(*names)
    assert runtime.find_libllvm() == (folder / chosen if chosen else None)


def test_two_names_of_one_file_are_one_library(machine):
    folder = machine("libLLVM.so.19.1")
    (folder / "libLLVM-19.so").symlink_to("libLLVM.so.19.1")
    (folder / "libLLVM.so").symlink_to("libLLVM-19.so")
    assert runtime.installed_libraries() == [runtime.LlvmLibrary(folder / "libLLVM.so.19.1", 19)]


def test_a_name_without_version_is_resolved_or_asked(machine):
    folder = machine("libLLVM.so")  # an empty file, which cannot answer
    assert runtime.llvm_major(folder / "libLLVM.so") == 0
    assert runtime.find_libllvm() is None


@pytest.mark.parametrize("major", [14, 15, 16])
def test_refuses_what_aborts(machine, major):
    machine(f"libLLVM-{major}.so.1")
    with pytest.raises(SetupError) as caught:
        runtime.require_libllvm()
    text = str(caught.value)
    assert f"(LLVM {major})" in text
    assert "apt-get install -y --no-install-recommends libllvm19" in text
    assert "\n" not in text


def test_nothing_installed(machine):
    machine()
    with pytest.raises(SetupError, match=r"no libLLVM found.*apt-get install"):
        runtime.require_libllvm()


def test_the_users_choice_is_the_only_one(machine, monkeypatch):
    folder = machine("libLLVM.so.19.1", "libLLVM.so.18.1", "libLLVM-15.so.1")
    monkeypatch.setenv(runtime.LIBRARY_PATH_VARIABLE, str(folder / "libLLVM.so.18.1"))
    assert runtime.find_libllvm() == folder / "libLLVM.so.18.1"
    monkeypatch.setenv(runtime.LIBRARY_PATH_VARIABLE, str(folder / "libLLVM-15.so.1"))
    assert runtime.find_libllvm() is None
    with pytest.raises(SetupError, match=r"DRJIT_LIBLLVM_PATH points to .*libLLVM-15.so.1 \(LLVM 15\)"):
        runtime.require_libllvm()
    monkeypatch.setenv(runtime.LIBRARY_PATH_VARIABLE, str(folder / "absent.so"))
    with pytest.raises(SetupError, match="which is no file"):
        runtime.require_libllvm()


@pytest.mark.parametrize("text", ["0", "-1", "two", "1.5"])
def test_thread_count_of_the_environment_is_checked(monkeypatch, text):
    monkeypatch.setenv(runtime.THREADS_VARIABLE, text)
    with pytest.raises(SetupError, match="positive integer"):
        runtime.activate()


def test_thread_count_argument_is_checked():
    with pytest.raises(SetupError, match="at least 1"):
        runtime.activate(num_threads=0)


@pytest.mark.parametrize(("text", "expected"), [(None, "cpu"), ("", "cpu"), ("cpu", "cpu"), ("cuda", "cuda")])
def test_the_device_is_that_of_the_environment(monkeypatch, text, expected):
    monkeypatch.delenv(runtime.DEVICE_VARIABLE, raising=False)
    if text is not None:
        monkeypatch.setenv(runtime.DEVICE_VARIABLE, text)
    assert runtime.chosen_device() == expected


@pytest.mark.parametrize("text", ["gpu", "CUDA", "llvm_ad_rgb", "cuda:0"])
def test_an_unknown_device_is_refused(monkeypatch, text):
    monkeypatch.setenv(runtime.DEVICE_VARIABLE, text)
    with pytest.raises(SetupError, match=f"^WAVEFORMER_DEVICE must be cpu or cuda, got '{text}'$"):
        runtime.activate()


LIGHT = """
import sys
import waveformer.simulator.runtime
heavy = {"drjit", "mitsuba", "numpy", "torch"} & set(sys.modules)
assert not heavy, f"the module itself must stay light, it loads {heavy}"
"""
ACTIVATE = """
from waveformer.simulator.runtime import activate
activate()
activate({argument})
import drjit, mitsuba
assert mitsuba.variant() == "llvm_ad_rgb"
assert drjit.thread_count() == {expected}, drjit.thread_count()
assert list(drjit.maximum(mitsuba.Float([1, -2]), 0)) == [1, 0]
"""
CUDA = """
import os
from waveformer.simulator.errors import SetupError
from waveformer.simulator.runtime import LIBRARY_PATH_VARIABLE, activate
os.environ["WAVEFORMER_DEVICE"] = "cuda"
try:
    activate()
except SetupError as error:  # no GPU here
    assert "cuda_ad_rgb does not start" in str(error) and "unset WAVEFORMER_DEVICE" in str(error), error
    assert "\\n" not in str(error)
else:
    import mitsuba
    assert mitsuba.variant() == "cuda_ad_rgb"
assert LIBRARY_PATH_VARIABLE not in os.environ, "CUDA needs no LLVM"
"""
OTHER_VARIANT = """
import mitsuba
mitsuba.set_variant("scalar_rgb")
"""


@pytest.mark.parametrize(
    "code",
    [
        LIGHT,
        ACTIVATE.format(argument="", expected=2),
        ACTIVATE.format(argument="num_threads=1", expected=1),
        CUDA,
        OTHER_VARIANT + ACTIVATE.format(argument="", expected=2),
    ],
)
def test_in_a_fresh_process(monkeypatch, code):
    monkeypatch.delenv(runtime.LIBRARY_PATH_VARIABLE, raising=False)
    monkeypatch.delenv(runtime.DEVICE_VARIABLE, raising=False)
    monkeypatch.setenv(runtime.THREADS_VARIABLE, "2")
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr
