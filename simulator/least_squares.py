"""Fits of the forward model to a measured signal: Levenberg-Marquardt, coarse to fine.

The phase of an echo turns by a full turn every half wavelength, so the plain misfit is convex only within about an
eighth of a wavelength of the truth. Two things widen that: each group of antennas may keep a complex gain of its own,
which leaves what happens inside the group (small groups see slopes of the wavefront only, which turn slowly), and a
part of the band. Stages go from small groups to the whole aperture, and from a part of the band to all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch.autograd import forward_ad

from waveformer.simulator.arguments import samples, shown
from waveformer.simulator.errors import MeshError, RadarError

Model = Callable[[torch.Tensor], torch.Tensor]

# Steps end where they lower the misfit by less than this share of it.
_SMALLEST_GAIN = 1e-6
_FIRST_DAMPING, _SMALLEST_DAMPING, _LARGEST_DAMPING = 1e-3, 1e-9, 1e6
# Directions whose curvature, in units of the scales, is below this share of the largest stay where they are: free gains
# leave rounding errors of single precision in the place of a parameter that they make unobservable.
_SMALLEST_CURVATURE = 1e-9
# In units of the scales: farther away the model of the misfit says nothing, and a step may end where no echo is left.
_LONGEST_STEP = 2.0
# Times the share above far from the least number there is, and below any curvature of a signal.
_LEAST_CURVATURE = 1e-200


@dataclass(frozen=True, eq=False)
class Stage:
    """What one stage of a fit compares.

    Attributes:
        groups: group of every antenna pair, shape (N,), each with a free complex gain; None compares the signal
            as it is, with its phase and level.
        bandwidth_share: part of the band around its centre, up to 1.
        max_iterations: of Levenberg-Marquardt.
    """

    groups: torch.Tensor | None = None
    bandwidth_share: float = 1.0
    max_iterations: int = 20

    def __post_init__(self) -> None:
        if not 0.0 < self.bandwidth_share <= 1.0:
            raise RadarError(f"bandwidth_share must lie in 0 .. 1, got {self.bandwidth_share!r}")

    def on(self, measured: torch.Tensor) -> Stage:
        """The same on the device of a signal; RadarError if its groups are not those of the signal's pairs."""
        groups = self.groups
        if groups is None:
            return self
        whole = isinstance(groups, torch.Tensor) and not (groups.is_floating_point() or groups.is_complex())
        if not whole or groups.shape != measured.shape[:1] or bool((groups < 0).any()):
            raise RadarError(
                f"groups must be whole numbers from 0, one for each of {len(measured)} pairs, got {shown(groups)}"
            )
        return replace(self, groups=groups.to(measured.device, torch.int64))


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit.

    Attributes:
        values: parameters (P,), on the device of the measured signal.
        misfit: power of the residual over that of the signal, in the last stage: about 1 / SNR where the model is right.
        deviations: standard deviations of the parameters if the residual is noise (P,); infinite for those that
            neither the last stage nor a prior tells.
        history: misfit after every accepted step of all stages.
    """

    values: torch.Tensor
    misfit: float
    deviations: torch.Tensor
    history: tuple[float, ...]


def fit(
    model: Model,
    measured: torch.Tensor,
    start: torch.Tensor,
    scales: torch.Tensor,
    stages: Sequence[Stage] = (Stage(),),
    *,
    prior_deviations: torch.Tensor | None = None,
) -> Fit:
    """Parameters whose signal is closest to the measured one.

    Args:
        model: from parameters (P,) float64 to a signal (N, T) that carries forward derivatives, such as
            `differentiable.simulate`; both on the device of the measured signal.
        measured: signal (N, T), complex.
        start: parameters to start from (P,).
        scales: how much of every parameter matters (P,): a wavelength for a length. They condition the solver, and no
            step is longer than two of them.
        stages: coarse to fine.
        prior_deviations: standard deviations of the parameters about `start`, known beforehand (P,); infinite where
            nothing is known. The noise is taken from the misfit.

    Raises:
        RadarError: shapes do not fit, numbers are not finite, the signal is zero everywhere, there is no stage.
    """
    if not isinstance(measured, torch.Tensor) or not measured.is_complex() or measured.ndim != 2:
        raise RadarError(f"measured must be a complex tensor of shape (N, T), got {shown(measured)}")
    samples("measured", measured, (measured.shape[0], measured.shape[1]))
    begin = _parameters("start", start, measured)
    steps = _parameters("scales", scales, measured, len(begin))
    prior = torch.full_like(begin, torch.inf)
    if prior_deviations is not None:
        prior = _parameters("prior_deviations", prior_deviations, measured, len(begin))
    for name, given in (("scales", steps), ("prior_deviations", prior)):
        if not bool((given > 0).all()):
            raise RadarError(f"{name} must be positive, got {shown(given.tolist())}")
    if len(stages) == 0:
        raise RadarError("a fit needs at least one stage, got none: leave stages out or give a Stage")
    problem = _Problem(model, measured, begin, steps, (steps / prior) ** 2)
    values, history = begin.clone(), []
    for stage in stages:
        values, last, accepted = _descend(problem, values, stage.on(measured))
        history += accepted
    return Fit(values, last[0], last[1], tuple(history))


def linearise(model: Model, values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Signal (N, T) and its derivatives by every parameter, (P, N, T), by forward mode."""
    columns = []
    signal = None
    for place in range(len(values)):
        with forward_ad.dual_level():
            tangent = torch.zeros_like(values)
            tangent[place] = 1.0
            output = model(forward_ad.make_dual(values, tangent))  # type: ignore[no-untyped-call]
            both: Any = forward_ad.unpack_dual(output)  # type: ignore[no-untyped-call]
            signal = both.primal.clone()
            columns.append(torch.zeros_like(signal) if both.tangent is None else both.tangent.clone())
    if signal is None:
        raise RadarError("there is no parameter to differentiate by: give at least one")
    return signal.detach(), torch.stack(columns).detach()


@dataclass(frozen=True, eq=False)
class _Problem:
    """What all stages share; precision is that of the prior about `start`, in units of the scales."""

    model: Model
    measured: torch.Tensor
    start: torch.Tensor
    scales: torch.Tensor
    precision: torch.Tensor

    def linearised(self, values: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        signal, columns = linearise(self.model, values)
        if signal.shape != self.measured.shape:
            raise RadarError(
                f"measured of shape {tuple(self.measured.shape)} must have that of the model, {tuple(signal.shape)}"
            )
        return signal, columns

    def penalty(self, values: torch.Tensor) -> float:
        """Squared distance from the start in standard deviations of the prior."""
        return float((self.precision * ((values - self.start) / self.scales) ** 2).sum())


def _descend(
    problem: _Problem, values: torch.Tensor, stage: Stage
) -> tuple[torch.Tensor, tuple[float, torch.Tensor], list[float]]:
    """Levenberg-Marquardt for one stage: parameters, (misfit, deviations), history."""
    scales, precision = problem.scales, problem.precision
    band = _band(problem.measured, stage.bandwidth_share)
    target = problem.measured[:, band]
    power = float((target.abs() ** 2).sum())
    if power == 0.0:
        raise RadarError(
            f"measured is zero in the part of the band that a stage compares, {stage.bandwidth_share}"
        )
    damping, history = _FIRST_DAMPING, []
    signal, columns = problem.linearised(values)
    cost = _misfit(signal[:, band], target, stage.groups) / power
    for _ in range(stage.max_iterations):
        residual, jacobian = _projected(signal[:, band], columns[:, :, band], target, stage.groups)
        jacobian = jacobian * scales[:, None]
        # a prior weighs as much as noise of the present misfit
        noise = max(cost * power / residual.numel(), 1e-30)
        normal = jacobian @ jacobian.T + torch.diag(precision * noise)
        slope = jacobian @ residual - precision * noise * (values - problem.start) / scales
        # with a floor, so that a model that knows none of its parameters leaves them where they are
        largest = max(float(normal.diagonal().max()), _LEAST_CURVATURE)
        still = (
            _SMALLEST_CURVATURE * largest * torch.eye(len(values), dtype=normal.dtype, device=normal.device)
        )
        whole = cost * power + noise * problem.penalty(values)
        improved = False
        while damping < _LARGEST_DAMPING and not improved:
            damped = normal + damping * normal.diagonal().diag() + still
            step = torch.linalg.solve(damped, slope)
            step = step * min(1.0, _LONGEST_STEP / max(float(step.abs().max()), _LONGEST_STEP))
            if float(step @ slope) < _SMALLEST_GAIN * whole:  # not even the model of the misfit promises more
                break
            trial = values + step * scales
            trial_power = _trial(problem.model, trial, band, target, stage.groups)
            trial_whole = trial_power + noise * problem.penalty(trial)
            improved = trial_whole < whole
            damping = max(damping / 10.0, _SMALLEST_DAMPING) if improved else damping * 10.0
        if not improved:
            break
        values, cost = trial, trial_power / power
        history.append(cost)
        if whole - trial_whole < _SMALLEST_GAIN * whole or float((step.abs()).max()) < 1e-7:
            break
        signal, columns = problem.linearised(values)
    residual, jacobian = _projected(signal[:, band], columns[:, :, band], target, stage.groups)
    noise = cost * power / residual.numel()
    jacobian = jacobian * scales[:, None]
    normal = jacobian @ jacobian.T + torch.diag(precision * noise)
    return values, (cost, scales * _deviations(normal, noise)), history


def _parameters(name: str, value: Any, measured: torch.Tensor, count: int | None = None) -> torch.Tensor:
    """One number for every parameter as float64 on the device of the signal; only deviations may be infinite."""
    fits = isinstance(value, torch.Tensor) and value.ndim == 1 and not value.is_complex() and len(value) > 0
    if not fits or (count is not None and len(value) != count):
        wanted = "(P,) with P >= 1" if count is None else f"({count},), one for each parameter"
        raise RadarError(f"{name} must be a real tensor of shape {wanted}, got {shown(value)}")
    numbers: torch.Tensor = value.detach().to(measured.device, torch.float64)
    if bool(numbers.isnan().any()) or (name != "prior_deviations" and bool(numbers.isinf().any())):
        raise RadarError(f"{name} must be finite, got {shown(numbers.tolist())}")
    return numbers


def _deviations(normal: torch.Tensor, noise: float) -> torch.Tensor:
    """Standard deviations in units of the scales; infinite where the normal matrix has no curvature."""
    curvatures, directions = torch.linalg.eigh(normal)
    told = curvatures > _SMALLEST_CURVATURE * curvatures.max()
    squares = directions**2
    variances = noise * (squares[:, told] / curvatures[told]).sum(dim=1)
    return torch.where(squares[:, ~told].sum(dim=1) > 1e-6, torch.inf, variances).sqrt()


def _trial(
    model: Model, values: torch.Tensor, band: slice, target: torch.Tensor, groups: torch.Tensor | None
) -> float:
    """Power of the residual; infinite where the model refuses the values, such as a permittivity below 1."""
    try:
        return _misfit(model(values).detach()[:, band], target, groups)
    except (RadarError, MeshError):
        return float("inf")


def _band(measured: torch.Tensor, share: float) -> slice:
    """The middle samples of the band."""
    count = measured.shape[1]
    kept = max(1, round(share * count))
    return slice((count - kept) // 2, (count - kept) // 2 + kept)


def _gains(signal: torch.Tensor, target: torch.Tensor, groups: torch.Tensor | None) -> torch.Tensor:
    """Best complex gain of every pair's group, shape (N, 1); ones without groups."""
    if groups is None:
        return torch.ones((len(signal), 1), dtype=signal.dtype, device=signal.device)
    return _group_sums((signal.conj() * target).sum(1), groups) / _group_power(signal, groups)


def _group_sums(per_pair: torch.Tensor, groups: torch.Tensor) -> torch.Tensor:
    """Sum over the group of every pair, shape (N, 1)."""
    sums = torch.zeros(int(groups.max()) + 1, dtype=per_pair.dtype, device=per_pair.device)
    sums = sums.index_add(0, groups, per_pair)
    return sums[groups][:, None]


def _group_power(signal: torch.Tensor, groups: torch.Tensor) -> torch.Tensor:
    return _group_sums((signal.abs() ** 2).sum(1), groups).clamp(min=1e-30)


def _misfit(signal: torch.Tensor, target: torch.Tensor, groups: torch.Tensor | None) -> float:
    """Power of the residual."""
    return float(((target - _gains(signal, target, groups) * signal).abs() ** 2).sum())


def _projected(
    signal: torch.Tensor, columns: torch.Tensor, target: torch.Tensor, groups: torch.Tensor | None
) -> tuple[torch.Tensor, torch.Tensor]:
    """Residual (2NT,) and Jacobian (P, 2NT) in real numbers, free gains projected out (Golub & Pereyra 1973)."""
    gains = _gains(signal, target, groups)
    residual = target - gains * signal
    moved = []
    for column in columns:
        if groups is not None:
            share = _group_sums((signal.conj() * column).sum(1), groups) / _group_power(signal, groups)
            column = column - share * signal
        moved.append(torch.view_as_real((gains * column).to(torch.complex128)).reshape(-1))
    return torch.view_as_real(residual.to(torch.complex128)).reshape(-1), torch.stack(moved)
