"""NumPy arrays to Dr.Jit and back, in a form that keeps its kernels in the cache."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Float, UInt32

# On the CPU Dr.Jit wraps NumPy memory without a copy and compiles loads for the alignment it happens to find:
# unaligned memory means a new kernel, 50 to 100 ms, on every call. CUDA's types copy it to the GPU instead.
_ALIGNMENT_BYTES = 64


def to_device(array: NDArray[Any]) -> Float:
    """Float32 array of the values, flattened."""
    return Float(_aligned(array, np.dtype(np.float32)))


def to_device_index(array: NDArray[Any]) -> UInt32:
    """Uint32 array of the values, flattened."""
    return UInt32(_aligned(array, np.dtype(np.uint32)))


def to_device_vectors(array: NDArray[Any]) -> Array3f:
    """Float32 vectors from shape (N, 3)."""
    return Array3f(*(to_device(array[:, i]) for i in range(3)))


def _aligned(array: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    size = array.size * dtype.itemsize
    raw = np.empty(size + _ALIGNMENT_BYTES, dtype=np.uint8)
    start = -raw.ctypes.data % _ALIGNMENT_BYTES
    aligned = raw[start : start + size].view(dtype)
    aligned[...] = np.asarray(array).reshape(-1)
    return aligned
