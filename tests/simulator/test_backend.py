"""Kernels compute with the array types of the chosen device. CUDA's types can be named without a GPU."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waveformer.simulator import backend, runtime
from waveformer.simulator.errors import SetupError

SIMULATOR = Path(__file__).resolve().parents[2] / "simulator"
KERNELS = """
import sys
from waveformer.simulator import backend, device, exact_echo, fast_echo, image_blocks
types = {array.__module__ for array in (backend.Array3f, backend.Array4f, backend.Complex2f, backend.Float, backend.UInt32)}
assert fast_echo.Float is backend.Float
assert device.UInt32 is backend.UInt32
assert "mitsuba" not in sys.modules  # the types alone start nothing
print(backend.DEVICE, *types)
"""


def in_a_fresh_process(code: str, device: str | None) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if key != runtime.DEVICE_VARIABLE}
    environment |= {} if device is None else {runtime.DEVICE_VARIABLE: device}
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment
    )


@pytest.mark.parametrize(
    ("device", "expected"),
    [
        (None, "cpu drjit.llvm.ad"),
        ("", "cpu drjit.llvm.ad"),
        ("cpu", "cpu drjit.llvm.ad"),
        ("cuda", "cuda drjit.cuda.ad"),
    ],
)
def test_all_kernels_have_the_types_of_the_chosen_device(device: str | None, expected: str) -> None:
    child = in_a_fresh_process(KERNELS, device)
    assert child.stdout.strip() == expected, child.stderr


def test_the_types_are_those_of_the_variant(mitsuba_variant: str) -> None:
    import mitsuba as mi

    assert mitsuba_variant == runtime.VARIANTS[backend.DEVICE]
    assert (backend.Float, backend.UInt32) == (mi.Float, mi.UInt32)


def test_no_other_module_names_a_backend_of_drjit() -> None:
    for path in SIMULATOR.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            named = [name for name in names if name.startswith(("drjit.llvm", "drjit.cuda", "drjit.auto"))]
            assert not named or path.name == "backend.py", (
                f"{path.name}: import from waveformer.simulator.backend"
            )


def test_the_device_cannot_change_once_kernels_are_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    other = next(device for device in runtime.VARIANTS if device != backend.DEVICE)
    monkeypatch.setenv(runtime.DEVICE_VARIABLE, other)
    with pytest.raises(SetupError, match=f"asks for {other}, but the kernels of this process are loaded for"):
        runtime.activate()


@pytest.mark.usefixtures("mitsuba_variant")
def test_numbers_survive_the_way_to_the_device_and_back(rng: np.random.Generator) -> None:
    from waveformer.simulator.device import to_device, to_device_index, to_device_vectors

    numbers = rng.normal(size=(5, 3))
    assert (to_device(numbers).numpy() == numbers.astype(np.float32).ravel()).all()
    assert (to_device_vectors(numbers).numpy() == numbers.astype(np.float32).T).all()
    index = rng.integers(1000, size=7)
    assert (to_device_index(index).numpy() == index).all()
