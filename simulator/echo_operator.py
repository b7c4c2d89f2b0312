"""An echo as a function of continuous quantities, with all that is discrete held: value, adjoint and derivative.

What the differentiable model sums: the echo of a target, of the walls of a box, and of a sheet. Each knows its value,
its derivative along a `Direction`, and what a gradient of the signal means for its samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.adjoint_echo import adjoint_echo
from waveformer.simulator.blas import single_blas_thread
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.factorisation import Factorisation, TileWork
from waveformer.simulator.fast_echo import in_batches, sum_batches
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.response_plan import ResponsePlan
from waveformer.simulator.tangent_echo import Direction, tangent_echo


class EchoTerm(Protocol):
    """One summand of the signal."""

    def value(self) -> NDArray[np.complex64]:
        """The echo, shape (N, T)."""

    def derivative(self, direction: Direction) -> NDArray[np.complex64]:
        """Its derivative along a direction, shape (N, T)."""

    def sample_gradient(self, gradient: NDArray[np.complex64]) -> NDArray[np.float64]:
        """Gradient by the samples (S, 8) of a loss with this gradient (N, T) by the echo."""


@dataclass(frozen=True, eq=False)
class SurfaceEcho:
    """Echo of surface samples by the fast kernel.

    Attributes:
        plan: cells and bins.
        tiles: every tile of the aperture with what it sees.
        two_sided: whether the back of the surface reflects.
        response: factor W of a pair; None for 1.
        chirp, aperture: the radar, T samples and N pairs.
        scale: factor on the sum.
        matter_moves: velocity of the samples (S, 8) when a number of the matter grows, by that number.
    """

    plan: Factorisation
    tiles: tuple[TileWork, ...]
    two_sided: bool
    response: ResponsePlan | None
    chirp: Chirp
    aperture: Aperture
    scale: complex
    matter_moves: Callable[[Direction], NDArray[np.float64] | None] = lambda _: None

    def value(self) -> NDArray[np.complex64]:
        """The echo, shape (N, T)."""
        source = EchoSource(self.plan.samples, self.two_sided, 0.0, self.response)
        frequencies = 1 if self.response is None else len(self.response.frequencies_hz)
        h, add = self._accumulator()
        with single_blas_thread():
            batches = in_batches(self.tiles, frequencies)
            sum_batches(self.plan, batches, source, self.chirp, self.aperture, None, add)
        return h

    def derivative(self, direction: Direction) -> NDArray[np.complex64]:
        """Its derivative along a direction, shape (N, T)."""
        if (moves := self.matter_moves(direction)) is not None:
            direction = replace(direction, samples=moves)
        h, add = self._accumulator()
        with single_blas_thread():
            tangent_echo(
                self.plan,
                self.tiles,
                self.two_sided,
                self.response,
                self.chirp,
                self.aperture,
                direction,
                add,
            )
        return h

    def sample_gradient(self, gradient: NDArray[np.complex64]) -> NDArray[np.float64]:
        """Gradient by the samples (S, 8) of a loss with this gradient (N, T) by the echo."""
        scaled = gradient * np.complex64(np.conj(self.scale))
        with single_blas_thread():
            return adjoint_echo(
                self.plan, self.tiles, self.two_sided, self.response, self.chirp, self.aperture, scaled
            )

    def _accumulator(
        self,
    ) -> tuple[NDArray[np.complex64], Callable[[NDArray[np.int64], NDArray[np.complex64]], None]]:
        h = np.zeros((len(self.aperture), self.chirp.num_samples), dtype=np.complex64)

        def add(rows: NDArray[np.int64], echo: NDArray[np.complex64]) -> None:
            h[rows] += np.complex64(self.scale) * echo

        return h, add
