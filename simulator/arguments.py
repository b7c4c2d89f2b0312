"""Checks of what callers pass to the differentiable model and the fits: refused in one line that names the argument.

NumPy arrays and torch tensors alike; torch is loaded only where a tensor comes.
"""

from __future__ import annotations

import reprlib
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import MeshError, RadarError

Kind = TypeVar("Kind")

_SHORT = reprlib.Repr()
_SHORT.maxother = _SHORT.maxstring = 60


def shown(value: Any) -> str:
    """A value in a few words of one line: type and shape of what has them."""
    if hasattr(value, "dtype") and len(getattr(value, "shape", "")):
        return f"{value.dtype} of shape {tuple(value.shape)}"
    return " ".join(_SHORT.repr(value).split())


def instance(name: str, value: Any, kind: type[Kind]) -> Kind:
    """The value; RadarError unless it is of this class."""
    if not isinstance(value, kind):
        raise RadarError(f"{name} must be a {kind.__name__}, got {shown(value)}")
    return value


def as_array(value: Any) -> NDArray[Any] | None:
    """The value as a NumPy array, without gradient; None for what is none, such as ragged lists."""
    try:
        if hasattr(value, "detach"):
            value = value.detach().cpu().resolve_conj().resolve_neg().numpy()
        return np.asarray(value)
    except (TypeError, ValueError, RuntimeError):
        return None


def coordinates(name: str, value: Any) -> NDArray[np.float64]:
    """Finite real numbers (n, 3), n >= 1, without gradient; RadarError otherwise."""
    array = as_array(value)
    if (
        array is None
        or array.dtype.kind not in "iuf"
        or array.ndim != 2
        or array.shape[1] != 3
        or not len(array)
    ):
        raise RadarError(f"{name} must be real numbers of shape (n, 3) with n >= 1, got {shown(value)}")
    bad = int((~np.isfinite(array)).any(axis=1).sum())
    if bad:
        raise RadarError(
            f"{name} must be finite: {bad} of {len(array)} rows hold NaN or infinity; correct or leave out these rows"
        )
    return array.astype(np.float64)


def triangles(vertices: Any, faces: Any) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (V, 3) and faces (F, 3) of a mesh.

    Raises:
        RadarError: they are no finite real numbers of these shapes.
        MeshError: faces are not whole numbers that name vertices.
    """
    corners, index = coordinates("vertices", vertices), coordinates("faces", faces)
    whole = index.astype(np.int64)
    if not (whole == index).all() or whole.min() < 0 or whole.max() >= len(corners):
        raise MeshError(
            "mesh.index_range",
            f"faces must be whole numbers from 0 to {len(corners) - 1}, the rows of vertices, got "
            f"{index.min():g} to {index.max():g}",
        )
    return corners, whole


def samples(name: str, value: Any, shape: tuple[int, int]) -> NDArray[Any]:
    """Finite complex signal (N, T), not zero everywhere; RadarError otherwise."""
    array = as_array(value)
    if array is None or array.dtype.kind not in "iufc" or array.shape != shape:
        raise RadarError(
            f"{name} must be complex numbers of shape (positions, samples) = {shape}, got {shown(value)}"
        )
    bad = int((~np.isfinite(array)).sum())
    if bad:
        raise RadarError(
            f"{name} must be finite: {bad} of {array.size} samples are NaN or infinite; leave out their positions"
        )
    if not array.any():
        raise RadarError(f"{name} is zero everywhere: there is nothing to fit")
    return array if array.dtype.kind == "c" else array.astype(np.complex128)


def real_number(name: str, value: Any) -> float:
    """One finite real number, without gradient; RadarError otherwise."""
    number = _number(value)
    if number is None or number.dtype.kind not in "iuf":
        raise RadarError(f"{name} must be one real number, finite, got {shown(value)}")
    return float(number)


def complex_number(name: str, value: Any) -> complex:
    """One finite real or complex number, without gradient; RadarError otherwise."""
    number = _number(value)
    if number is None or number.dtype.kind not in "iufc":
        raise RadarError(f"{name} must be one number, finite, got {shown(value)}")
    return complex(number)


def follows(tensor: Any) -> bool:
    """Whether a tensor carries a derivative, backwards or forwards."""
    from torch.autograd import forward_ad

    dual: Any = forward_ad.unpack_dual(tensor)  # type: ignore[no-untyped-call]
    return tensor.requires_grad or dual.tangent is not None


def constant(name: str, value: Any) -> Any:
    """The value without torch; RadarError for a tensor whose derivative would be lost."""
    if not hasattr(value, "detach"):
        return value
    if follows(value):
        raise RadarError(f"{name} requires a gradient, but there is none for it: pass {name}.detach()")
    return as_array(value)


def _number(value: Any) -> NDArray[Any] | None:
    """Zero-dimensional and finite; None for anything else."""
    is_tensor = hasattr(value, "detach")
    if isinstance(value, bool) or not (
        is_tensor or isinstance(value, int | float | complex | np.generic | np.ndarray)
    ):
        return None
    array = as_array(value)
    if array is None or array.size != 1 or array.dtype.kind not in "iufc" or not np.isfinite(array).all():
        return None
    return array.reshape(())
