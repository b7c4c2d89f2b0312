"""An echo as an operation of torch, with a hand-written adjoint and a forward mode."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from waveformer.simulator.echo_operator import EchoTerm
from waveformer.simulator.errors import RadarError
from waveformer.simulator.response_plan import WallChange
from waveformer.simulator.tangent_echo import Direction


def differentiable_echo(
    term: EchoTerm,
    samples: torch.Tensor | None,
    tx_m: torch.Tensor,
    rx_m: torch.Tensor | None,
    matter: list[tuple[WallChange, torch.Tensor]],
) -> torch.Tensor:
    """The value of an echo, complex64 (N, T), on the device of the transmitters, that follows what it depends on.

    It has first derivatives only: a backward pass with create_graph raises RadarError.

    Args:
        term: the echo at the present values.
        samples: point, normal, area and taper of every sample (S, 8); None if they are constant.
        tx_m, rx_m: antennas (N, 3); rx_m None means monostatic.
        matter: numbers of the matter, real scalars.
    """
    changes = [change for change, _ in matter]
    numbers = [number for _, number in matter]
    result: torch.Tensor = _Echo.apply(  # type: ignore[no-untyped-call]
        term, changes, samples, tx_m, rx_m, *numbers
    )
    return result


class _Echo(torch.autograd.Function):
    """Backwards: samples by the adjoint kernel, all else by one derivative a number, since each is one number an
    antenna or one number in all.
    """

    @staticmethod
    def forward(
        term: EchoTerm,
        changes: list[WallChange],
        samples: torch.Tensor | None,
        tx_m: torch.Tensor,
        rx_m: torch.Tensor | None,
        *numbers: torch.Tensor,
    ) -> torch.Tensor:
        return torch.from_numpy(term.value()).to(tx_m.device)

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: torch.Tensor) -> None:
        ctx.term, ctx.changes, samples, tx_m, rx_m, *numbers = inputs
        ctx.device = tx_m.device
        ctx.inputs = [
            None if value is None else (value.dtype, value.device)
            for value in (samples, tx_m, rx_m, *numbers)
        ]

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> tuple[Any, ...]:
        # gradients are only tracked here with create_graph, and what follows leaves torch
        if torch.is_grad_enabled():
            raise RadarError("the echo has no second derivatives: call backward without create_graph")
        by_h = gradient.detach().resolve_conj().resolve_neg().cpu().numpy().astype(np.complex64)
        wanted = ctx.needs_input_grad[2:]
        results: list[NDArray[np.float64] | None] = [None] * len(wanted)
        if wanted[0]:
            results[0] = ctx.term.sample_gradient(by_h)
        for place, moving in ((1, _transmitters), (2, _receivers)):
            if wanted[place]:
                columns = [_per_antenna(ctx.term, by_h, moving(axis)) for axis in range(3)]
                results[place] = np.stack(columns, axis=1)
        for place, change in enumerate(ctx.changes, start=3):
            if wanted[place]:
                results[place] = np.array(
                    _per_antenna(ctx.term, by_h, Direction(matter=((change, 1.0),))).sum()
                )
        tensors = [
            None if value is None else torch.from_numpy(value).to(dtype=like[0], device=like[1])
            for value, like in zip(results, ctx.inputs, strict=True)
        ]
        return None, None, *tensors

    @staticmethod
    def jvp(ctx: Any, *tangents: Any) -> torch.Tensor:
        samples, tx_m, rx_m, *numbers = tangents[2:]
        rates = [
            (change, 0.0 if rate is None else float(rate))
            for change, rate in zip(ctx.changes, numbers, strict=True)
        ]
        velocities = None if samples is None else _velocity(samples)
        matter = tuple((change, rate) for change, rate in rates if rate != 0.0)
        parts = []
        if matter or (velocities is not None and velocities.any()):
            parts.append(ctx.term.derivative(Direction(samples=velocities, matter=matter)))
        for motion, moving in ((tx_m, _transmitters), (rx_m, _receivers)):
            if motion is not None:
                velocity = _velocity(motion)
                for axis in np.flatnonzero(velocity.any(axis=0)):
                    parts.append(velocity[:, axis, None] * ctx.term.derivative(moving(int(axis))))
        total = np.sum(parts, axis=0) if parts else np.zeros_like(ctx.term.value())
        return torch.from_numpy(total.astype(np.complex64)).to(ctx.device)


def _velocity(tangent: torch.Tensor) -> NDArray[np.float64]:
    return np.asarray(tangent.detach().cpu().double().numpy())


def _transmitters(axis: int) -> Direction:
    return Direction(transmitters_m=np.eye(3)[axis])


def _receivers(axis: int) -> Direction:
    return Direction(receivers_m=np.eye(3)[axis])


def _per_antenna(term: EchoTerm, by_h: NDArray[np.complex64], direction: Direction) -> NDArray[np.float64]:
    """DL along a direction, the part of every antenna (N,)."""
    return np.asarray((by_h.conj() * term.derivative(direction)).real.sum(axis=1, dtype=np.float64))
