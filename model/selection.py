"""Choice of the candidate surface whose simulated echo fits the measured one (mmNorm's optimisation)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from waveformer.model.level_choice import (
    Loss,
    added_responses,
    antenna_losses,
    component_losses,
    coordinate_descent,
    last_peak,
    residual_losses,
)
from waveformer.model.phase_agreement import profile_correlation
from waveformer.model.range_response import range_limits, range_responses
from waveformer.model.range_window import RangeWindow, measured_profiles, mmnorm_window, object_window
from waveformer.model.selected_antennas import choose_antennas
from waveformer.model.surfaces import SurfaceStack
from waveformer.simulator.errors import RadarError
from waveformer.simulator.measurement import Measurement

Value = TypeVar("Value")


class SelectionSettings(BaseModel):
    """How a level is chosen.

    Attributes:
        num_antennas: drawn at random among those with a clear echo; mmNorm takes 50.
        coherent: add the echoes of a surface with their phases; False adds powers, for comparison.
        window: "object" compares the range bins around the candidates; "mmnorm" its four fixed bins.
        loss: "complex" compares profiles with their phase, each antenna but for one complex factor; "magnitude" is mmNorm's.
        choice: "argmin" of the loss; or mmNorm's "last_peak", whose limits are made for its loss.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    num_antennas: int = Field(default=200, gt=0)
    coherent: bool = True
    window: Literal["object", "mmnorm"] = "object"
    loss: Loss = "complex"
    choice: Literal["argmin", "last_peak"] = "argmin"

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.loss == "complex" and not self.coherent:
            raise ValueError('powers have no phase: with coherent = false take loss = "magnitude"')
        if self.loss == "complex" and self.choice == "last_peak":
            raise ValueError(
                'the limits of "last_peak" are made for loss = "magnitude": take that, or "argmin"'
            )
        return self


@dataclass(frozen=True, eq=False)
class Selection:
    """The chosen level of every component.

    Attributes:
        level_index: position in the component's list of levels; -1 for a component without points.
        antenna_losses: loss of every level at every antenna, the other components at their choice, shape
            (L_c, n) a component; shape (0, n) without points.
        rows: antennas that took part, rows of the measurement, shape (n,).
        window: range bins of these antennas; None if nothing could be chosen.
        note: what the user should know: why nothing was chosen, or how the antennas were.
        correlations: complex correlation of the measured profile with that of every level, shape (L_c, n) a
            component, see `phase_agreement`; none if powers were added, which have no phase.
    """

    level_index: tuple[int, ...]
    antenna_losses: tuple[NDArray[np.float64], ...]
    rows: NDArray[np.int64]
    window: RangeWindow | None
    note: str = ""
    correlations: tuple[NDArray[np.complex128], ...] = ()

    @property
    def is_empty(self) -> bool:
        """True if no component has a chosen level; `note` says why."""
        return all(index < 0 for index in self.level_index)

    @property
    def losses(self) -> tuple[NDArray[np.float64], ...]:
        """Loss curve of every component, summed over antennas, shape (L_c,) each."""
        return tuple(losses.sum(axis=1) for losses in self.antenna_losses)


def select_levels(
    stacks: Sequence[SurfaceStack],
    level_counts: Sequence[int],
    measurement: Measurement,
    settings: SelectionSettings | None = None,
    *,
    rng: np.random.Generator,
) -> Selection:
    """The level of every component whose simulated echoes fit the measured ones best.

    Echoes of the components add. With `last_peak` each component then moves to its last clear minimum, the
    others held where the best fit has them.

    Args:
        stacks: surfaces of every component at all its levels, the largest component first.
        level_counts: number of levels of every component.
        measurement: the scan.
        settings: None means the defaults.
        rng: draws the antennas.

    Returns:
        The choice; empty, with a note, if there is no candidate or no signal in its range.

    Raises:
        RadarError: h or a stack holds non-finite numbers, or the levels of a stack do not fit.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    settings = settings or SelectionSettings()
    if not np.isfinite(measurement.h).all():
        raise RadarError("h holds non-finite samples: choose levels only with what was recorded whole")
    if len(stacks) != len(level_counts):
        raise RadarError(
            f"{len(stacks)} stacks of surfaces need as many level counts, got {len(level_counts)}"
        )
    for index, (stack, count) in enumerate(zip(stacks, level_counts, strict=True)):
        _check(index, stack, count)
    usable = [index for index, stack in enumerate(stacks) if len(stack.points_m)]
    if not usable:
        return _nothing(len(stacks), "no candidate surface has a point")

    aperture = measurement.aperture
    low = np.min([stacks[index].points_m.min(axis=0) for index in usable], axis=0)
    high = np.max([stacks[index].points_m.max(axis=0) for index in usable], axis=0)
    if settings.window == "mmnorm":
        window = mmnorm_window(measurement.chirp, len(aperture))
    else:
        window = object_window(measurement.chirp, *range_limits(low, high, aperture.tx_m, aperture.rx_m))
    profiles = measured_profiles(measurement, np.arange(len(aperture)), window)
    rows, note = choose_antennas(np.abs(profiles), settings.num_antennas, rng)
    if len(rows) == 0:
        return _nothing(len(stacks), note)

    window, measured = window.take(rows), profiles[rows]
    receivers = None if aperture.rx_m is None else aperture.rx_m[rows]
    responses = [
        range_responses(
            stacks[index], level_counts[index], aperture.tx_m[rows], receivers, measurement.chirp, window,
            settings.coherent,
        )
        for index in usable
    ]  # fmt: skip
    chosen = coordinate_descent(measured, responses, settings.loss)
    if settings.choice == "last_peak":
        curves = [component_losses(measured, responses, chosen, i, settings.loss) for i in range(len(usable))]
        chosen = [last_peak(values.sum(axis=1), len(rows), len(usable) > 1) for values in curves]
    totals = [added_responses(responses, chosen, i) for i in range(len(usable))]
    phases = [profile_correlation(measured, total) for total in totals] if settings.coherent else []
    if settings.loss == "complex":
        losses = [residual_losses(correlation) for correlation in phases]
    else:
        losses = [antenna_losses(measured, total, settings.loss) for total in totals]
    no_losses, no_phases = np.empty((0, len(rows))), np.empty((0, len(rows)), dtype=np.complex128)
    return Selection(
        _by_component(chosen, usable, -1, len(stacks)),
        _by_component(losses, usable, no_losses, len(stacks)),
        rows,
        window,
        note,
        _by_component(phases, usable, no_phases, len(stacks)) if phases else (),
    )


def _by_component(
    values: Sequence[Value], usable: Sequence[int], missing: Value, count: int
) -> tuple[Value, ...]:
    """Values of the usable components in their places among all."""
    found = dict(zip(usable, values, strict=True))
    return tuple(found.get(index, missing) for index in range(count))


def _check(index: int, stack: SurfaceStack, count: int) -> None:
    for name in ("points_m", "normals", "areas_m2"):
        if not np.isfinite(getattr(stack, name)).all():
            raise RadarError(f"surfaces of component {index} hold non-finite {name}")
    if len(stack.points_m) and not (
        stack.level[0] >= 0 and stack.level[-1] < count and (np.diff(stack.level) >= 0).all()
    ):
        raise RadarError(f"surfaces of component {index} need ascending levels from 0 to {count - 1}")
    if not (stack.areas_m2 > 0).all():
        raise RadarError(f"surfaces of component {index} need positive areas")


def _nothing(num_components: int, note: str) -> Selection:
    empty = np.empty((0, 0))
    rows = np.empty(0, dtype=np.int64)
    return Selection((-1,) * num_components, (empty,) * num_components, rows, None, note)
