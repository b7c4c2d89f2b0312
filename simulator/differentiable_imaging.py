"""Imaging as torch operations: backprojection (Eq. 1) and projection, each the gradient of the other.

Both are linear. For y = M x torch wants M* applied to the gradient of y, with dL = Re(conj(gradient) dx), so the
gradient of `backproject` is `project`, and the other way round. Nothing is kept for the backward pass but the radar
and the grid, and gradients of gradients follow by the same rule. All is computed on the host by `imaging`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator import imaging
from waveformer.simulator.arguments import constant, instance, real_number
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

_Map = Callable[[NDArray[np.complex64]], NDArray[np.complex64]]


def backproject(
    h: torch.Tensor,
    chirp: Chirp,
    tx_m: ArrayLike | torch.Tensor,
    grid: Grid,
    rx_m: ArrayLike | torch.Tensor | None = None,
    *,
    range_bias_m: float = 0.0,
) -> torch.Tensor:
    """Image of a scan (Eq. 1), differentiable with respect to h: `imaging.backproject` in torch.

    Args:
        h: complex samples (N, T), on any device.
        chirp: T samples.
        tx_m, rx_m: antenna positions (N, 3), metres; rx_m None means monostatic. No gradient reaches them.
        grid: voxels (X, Y, Z).
        range_bias_m: known bias of the round-trip path, which is taken out. No gradient reaches it.

    Returns:
        Complex64 image (X, Y, Z) on the device of h.

    Raises:
        RadarError: h is no complex tensor of shape (N, T) or holds non-finite samples, a position or the bias
            makes no sense or requires a gradient; in the backward pass: the gradient holds non-finite values.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    instance("chirp", chirp, Chirp)
    instance("grid", grid, Grid)
    aperture = _aperture(tx_m, rx_m)
    bias_m = real_number("range_bias_m", constant("range_bias_m", range_bias_m))
    _check("h", h, (len(aperture), chirp.num_samples))

    def image_of(samples: NDArray[np.complex64]) -> NDArray[np.complex64]:
        return imaging.backproject(Measurement(samples, chirp, aperture, range_bias_m=bias_m), grid)

    def samples_of(image: NDArray[np.complex64]) -> NDArray[np.complex64]:
        bias = np.exp(-2j * np.pi * chirp.frequencies_hz * bias_m / SPEED_OF_LIGHT_M_PER_S)
        return np.asarray(imaging.project(image, grid, chirp, aperture) * bias.astype(np.complex64))

    return _apply(h, image_of, samples_of)


def project(
    image: torch.Tensor,
    grid: Grid,
    chirp: Chirp,
    tx_m: ArrayLike | torch.Tensor,
    rx_m: ArrayLike | torch.Tensor | None = None,
) -> torch.Tensor:
    """Echo of voxels of unit gain, differentiable with respect to the image: `imaging.project` in torch.

    Args:
        image: complex values (X, Y, Z), on any device.
        grid: its voxels.
        chirp: T samples.
        tx_m, rx_m: antenna positions (N, 3), metres; rx_m None means monostatic. No gradient reaches them.

    Returns:
        Complex64 samples (N, T) on the device of the image.

    Raises:
        RadarError: image is no complex tensor of the grid's shape or holds non-finite values, a position makes no
            sense or requires a gradient; in the backward pass: the gradient holds non-finite values.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    instance("chirp", chirp, Chirp)
    instance("grid", grid, Grid)
    aperture = _aperture(tx_m, rx_m)
    _check("image", image, grid.shape)

    def samples_of(values: NDArray[np.complex64]) -> NDArray[np.complex64]:
        return imaging.project(values, grid, chirp, aperture)

    def image_of(samples: NDArray[np.complex64]) -> NDArray[np.complex64]:
        return imaging.backproject(Measurement(samples, chirp, aperture), grid)

    return _apply(image, samples_of, image_of)


class _Linear(torch.autograd.Function):
    """A linear map of complex64 arrays on the host, and its adjoint as its gradient."""

    @staticmethod
    def forward(ctx: Any, values: torch.Tensor, forward: _Map, adjoint: _Map) -> torch.Tensor:
        ctx.forward_map, ctx.adjoint_map = forward, adjoint
        # torch keeps conjugation and sign as flags, which NumPy does not know
        return torch.from_numpy(forward(values.detach().resolve_conj().resolve_neg().numpy()))

    @staticmethod
    def backward(ctx: Any, *gradients: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        (gradient,) = gradients
        if not gradient.isfinite().all():
            raise RadarError("the gradient that reaches the image operator holds non-finite values")
        return _apply(gradient, ctx.adjoint_map, ctx.forward_map), None, None

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> torch.Tensor:
        return _apply(tangents[0], ctx.forward_map, ctx.adjoint_map)


def _apply(values: torch.Tensor, forward: _Map, adjoint: _Map) -> torch.Tensor:
    on_host = values.to("cpu", torch.complex64)
    result: torch.Tensor = _Linear.apply(on_host, forward, adjoint)  # type: ignore[no-untyped-call]
    return result.to(values.device)


def _check(name: str, values: torch.Tensor, shape: tuple[int, ...]) -> None:
    if not isinstance(values, torch.Tensor):
        raise RadarError(f"{name} must be a torch tensor, got {type(values).__name__}")
    if not values.is_complex():
        raise RadarError(f"{name} must be complex, got {values.dtype}")
    if tuple(values.shape) != shape:
        raise RadarError(f"{name} must have shape {shape}, got {tuple(values.shape)}")
    bad = int((~values.isfinite()).sum())
    if bad:
        raise RadarError(
            f"{name} holds {bad} values that are NaN or infinite, of {values.numel()}: set them to zero"
        )


def _aperture(tx_m: ArrayLike | torch.Tensor, rx_m: ArrayLike | torch.Tensor | None) -> Aperture:
    return Aperture(constant("tx_m", tx_m), None if rx_m is None else constant("rx_m", rx_m))
