"""Dr.Jit's array types of the device in use: the one place where kernels on CPU and CUDA differ.

Kernel modules take their types from here. They belong to the Mitsuba variant that `runtime.activate()` sets for
``WAVEFORMER_DEVICE``. Types once imported stay what they are, so the first import settles the device of the process
and `activate()` refuses another one from then on.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from waveformer.simulator.runtime import chosen_device

__all__ = ["DEVICE", "Array2f", "Array3f", "Array4f", "Complex2f", "Float", "UInt32"]

DEVICE = chosen_device()

if TYPE_CHECKING:
    from drjit.llvm.ad import Array2f, Array3f, Array4f, Complex2f, Float, UInt32
else:
    _types = importlib.import_module({"cpu": "drjit.llvm.ad", "cuda": "drjit.cuda.ad"}[DEVICE])
    Array2f, Array3f, Array4f = _types.Array2f, _types.Array3f, _types.Array4f
    Complex2f = _types.Complex2f
    Float, UInt32 = _types.Float, _types.UInt32
