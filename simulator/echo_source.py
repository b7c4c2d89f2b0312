"""One target as the kernels see it."""

from __future__ import annotations

from dataclasses import dataclass

from waveformer.simulator.quadrature import SurfaceSamples
from waveformer.simulator.response_plan import ResponsePlan


@dataclass(frozen=True, eq=False)
class EchoSource:
    """Samples of one target and what its echo depends on.

    Attributes:
        samples: surface samples in the radar frame.
        two_sided: whether the back of the surface reflects.
        closest_m: smallest distance from an antenna to the target.
        response: the factor W of a pair; None if it is constant and left to the caller.
    """

    samples: SurfaceSamples
    two_sided: bool
    closest_m: float
    response: ResponsePlan | None = None
