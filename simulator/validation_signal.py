"""Validation of the raw signal: where a target appears in range, how phase and level move, and imaging."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from waveformer.simulator import primitives
from waveformer.simulator.closed_forms import polygon_near
from waveformer.simulator.grid import Grid
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.target import Target
from waveformer.simulator.validation_result import (
    FAR_RANGE,
    MITO_BAND,
    CheckResult,
    ComplexArray,
    Trial,
    level_db,
    phase_deg,
    placed,
    worst,
)

_ZERO_PADDING = 64


def range_peak_m(h: ComplexArray, chirp: Chirp) -> float:
    """One-way range of the strongest echo of one position, from its zero-padded range profile.

    Args:
        h: dechirped samples, shape (T,).
        chirp: their chirp; the range is unambiguous up to T range bins.
    """
    profile = np.abs(np.fft.ifft(h, _ZERO_PADDING * len(h)))  # conjugate kernel: peaks at positive delay
    top = int(profile.argmax())
    before, at, after = (float(profile[(top + i) % len(profile)]) for i in (-1, 0, 1))
    fraction = 0.5 * (before - after) / (before - 2 * at + after)
    return (top + fraction) / _ZERO_PADDING * chirp.range_bin_m


def point_range(trial: Trial) -> Iterator[CheckResult]:
    """Ideal points appear where they are."""
    from waveformer.simulator import points

    depth = np.linspace(0.2, 1.2, 9)
    error, origin = [], Aperture(np.zeros((1, 3)))
    for z in depth:
        measurement = points.simulate_points([[0, 0, -z]], [0.01], MITO_BAND, origin)
        error.append(range_peak_m(np.asarray(measurement.h, complex)[0], MITO_BAND) - z)
    yield CheckResult(
        "ideal points at 0.2-1.2 m", "worst error of the profile's peak, of a range bin",
        100 * worst(np.array(error)) / MITO_BAND.range_bin_m, 2.0, "%", "the points' distances",
        "peak of a Dirichlet kernel padded 64 times; 2 % of a bin is 1 mm", "",
    )  # fmt: skip


def sphere_range(trial: Trial) -> Iterator[CheckResult]:
    """A sphere appears at its nearest point, and its phase follows a millimetre's motion."""
    radius, count = 0.05, trial.pick(12, 6, 4)
    rng = trial.rng("range")
    depth = rng.uniform(0.3, 0.5, count)
    # The target stays; antennas at different heights, and the same ones a millimetre closer
    near = np.column_stack([np.zeros((count, 2)), depth])
    target = Target(
        primitives.sphere(radius, 1.05e-3), pose=placed((0, 0, 0), Rotation.random(rng=rng).as_matrix())
    )
    h = trial.simulate(target, MITO_BAND, Aperture(np.vstack([near, near - [0, 0, 1e-3]])))
    error = [range_peak_m(row, MITO_BAND) - (z - radius) for row, z in zip(h, depth, strict=False)]
    yield CheckResult(
        "sphere a = 5 cm at 0.3-0.5 m", f"worst error of the profile's peak over {count} distances, of a range bin",
        100 * worst(np.array(error)) / MITO_BAND.range_bin_m, 2.0, "%", "distance to the nearest point",
        "the echo of a large sphere comes from its front; 2 % of a bin is 1 mm", trial.mode,
    )  # fmt: skip
    k = 2 * np.pi * MITO_BAND.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    turn = phase_deg(h[count:] / h[:count] * np.exp(-2j * k * 1e-3))
    yield CheckResult(
        "sphere a = 5 cm brought 1 mm closer", f"worst error of the phase change over {count} distances",
        worst(turn), 0.2, "deg", "2k per metre: 190 deg per mm",
        "0.2 deg is a micrometre: the facets seen hardly change over a millimetre", trial.mode,
    )  # fmt: skip


def level_over_range(trial: Trial) -> Iterator[CheckResult]:
    """A small plate from 2 to 8 m: received power falls with the fourth power of the range."""
    side = 0.02
    distance = np.linspace(2.0, 8.0, trial.pick(25, 13, 7))
    antennas = np.column_stack([np.zeros((len(distance), 2)), distance])
    h = trial.simulate(primitives.plate(side, side), FAR_RANGE, Aperture(antennas))
    scaled = level_db(h * distance[:, None] ** 2)
    yield CheckResult(
        "plate 2 cm from 2 to 8 m", "spread of |h| R^2", float(np.ptp(scaled, axis=0).max()), 0.02, "dB",
        "radar equation, 1 / R^4 in power", "the curved wavefront at 2 m costs 0.005 dB", trial.mode,
    )  # fmt: skip
    corner = side / 2
    corners = [[-corner, -corner, 0], [corner, -corner, 0], [corner, corner, 0], [-corner, corner, 0]]
    truth = polygon_near(corners, antennas, FAR_RANGE.frequencies_hz)
    yield CheckResult(
        "plate 2 cm from 2 to 8 m", "worst level error", worst(level_db(h / truth)), 0.02, "dB",
        "physical optics of the polygon as an edge integral", "flat body: quadrature error only", trial.mode,
    )  # fmt: skip


def adjoint_identity(trial: Trial) -> Iterator[CheckResult]:
    """Backprojection is the adjoint of the point forward model: sign, factor 2 and conjugation at once."""
    from waveformer.simulator import imaging, points

    rng = trial.rng("adjoint")
    grid = Grid.box((-0.02, -0.02, -0.34), (0.02, 0.02, -0.28), 0.01)
    aperture = Aperture.planar_grid(6, 5, 0.01)
    measurement = points.simulate_points([[0, 0, -0.3]], [0.01], MITO_BAND, aperture)
    x, y = (rng.normal(size=s) + 1j * rng.normal(size=s) for s in (grid.shape, measurement.h.shape))
    forward = imaging.project(x.astype(np.complex64), grid, MITO_BAND, aperture)
    image = imaging.backproject(replace(measurement, h=y.astype(np.complex64)), grid)
    left, right = np.vdot(y, np.asarray(forward, complex)), np.vdot(np.asarray(image, complex), x)
    yield CheckResult(
        "random image and random signal", "<A x, y> against <x, A* y>",
        float(np.abs(left - right) / (np.linalg.norm(forward) * np.linalg.norm(y))), 1e-4, "relative",
        "definition of the adjoint", "an identity: only single-precision rounding is left", "",
    )  # fmt: skip


def focus(trial: Trial) -> Iterator[CheckResult]:
    """The image of a point has its peak at the point."""
    from waveformer.simulator import imaging, points

    spacing = 2e-3
    grid = Grid.box((-0.03, -0.03, -0.36), (0.03, 0.03, -0.24), spacing)
    point = np.array([0.0083, -0.0121, -0.3017])
    aperture = Aperture.planar_grid(24, 24, 4e-3)
    measurement = points.simulate_points([point], [0.01], MITO_BAND, aperture)
    image = np.abs(np.asarray(imaging.backproject(measurement, grid)))
    i, j, k = np.unravel_index(int(image.argmax()), image.shape)
    miss = np.array([grid.x[i], grid.y[j], grid.z[k]]) - point
    yield CheckResult(
        "image of one point through 24 x 24 positions", "largest coordinate error of the peak, of a voxel",
        worst(miss) / spacing, 1.0, "voxels", "the point's place",
        "the nearest voxel is within half a voxel; depth alone is broad, so one voxel is allowed", "",
    )  # fmt: skip
