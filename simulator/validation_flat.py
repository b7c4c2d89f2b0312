"""Validation on flat bodies against the physical-optics integral without approximation."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waveformer.simulator import primitives
from waveformer.simulator.closed_forms import (
    disc_near_axis,
    disc_near_axis_paraxial,
    infinite_plane,
    plate_far,
    polygon_near,
)
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture
from waveformer.simulator.target import Target
from waveformer.simulator.validation_result import (
    FAR_RANGE,
    MITO_BAND,
    CheckResult,
    FloatArray,
    Trial,
    level_db,
    placed,
    worst,
)

_EDGE_INTEGRAL = "physical optics of the polygon as an edge integral, no surface sampling"
_FLAT_WHY = (
    "a flat body has no mesh error, so the sum must be the integral; 1 % is 0.09 dB of the mirror's echo"
)


def _corners(side_x_m: float, side_y_m: float, depth_m: float = 0.0) -> FloatArray:
    x, y = side_x_m / 2, side_y_m / 2
    return np.array([[-x, -y, depth_m], [x, -y, depth_m], [x, y, depth_m], [-x, y, depth_m]])


def _arc(angle_rad: FloatArray, distance_m: float) -> FloatArray:
    return distance_m * np.stack([np.sin(angle_rad), np.zeros_like(angle_rad), np.cos(angle_rad)], axis=1)


def _row(x_m: FloatArray) -> FloatArray:
    return np.column_stack([x_m, np.full_like(x_m, 0.01), np.zeros_like(x_m)])


def plate_far_field(trial: Trial) -> Iterator[CheckResult]:
    """A 5 cm plate of two triangles at 20 m, antennas on an arc up to 15 degrees off its normal."""
    side, distance = 0.05, 20.0
    angle = np.radians(np.linspace(0, 15, trial.pick(61, 31, 16)))
    antennas = _arc(angle, distance)
    h = trial.simulate(primitives.plate(side, side), FAR_RANGE, Aperture(antennas))
    f = FAR_RANGE.frequencies_hz
    truth = polygon_near(_corners(side, side), antennas, f)
    sinc = plate_far(side, side, distance, f, direction_x=np.sin(angle)[:, None])
    dense = np.radians(np.linspace(0, 15, 301))
    curve = polygon_near(_corners(side, side), _arc(dense, distance), f[:1])
    wavelength = SPEED_OF_LIGHT_M_PER_S / f
    rcs = np.abs(h[0]) ** 2 * (4 * np.pi) ** 3 * distance**4 / wavelength**2
    name = "plate 5 cm at 20 m"
    yield CheckResult(
        name, "worst error of the peak's cross-section",
        worst(10 * np.log10(rcs * wavelength**2 / (4 * np.pi * side**4))), 0.05, "dB",
        "4 pi A^2 / lambda^2", "the curved wavefront at 20 m costs 0.002 dB; the rest is quadrature", trial.mode,
    )  # fmt: skip
    yield CheckResult(
        name, f"worst complex error of the pattern, {len(angle)} angles to 15 deg, of the peak",
        100 * worst(np.abs(h - truth)) / worst(np.abs(truth)), 1.0, "%", _EDGE_INTEGRAL,
        "nulls are scored on the scale of the peak: in a null a ratio means nothing", trial.mode,
        detail={
            "kind": "pattern", "x": np.degrees(angle), "measured_db": level_db(h[:, 0] / truth[0, 0]),
            "reference_x": np.degrees(dense), "reference_db": level_db(curve[:, 0] / curve[0, 0]),
            "worst_percent_against_sinc": 100 * worst(np.abs(h - sinc)) / worst(np.abs(sinc)),
        },
    )  # fmt: skip


def plate_near_field(trial: Trial) -> Iterator[CheckResult]:
    """Plates of 2 to 20 cm at 0.4 m, far inside their far-field distance of up to 21 m."""
    depth = 0.4
    for side in (0.05, 0.12) if trial.quick else (0.02, 0.05, 0.12, 0.20):
        rng, count = trial.rng(f"plate {side}"), trial.pick(40, 20, 10)
        reach = side / 2 + 0.03
        antennas = np.column_stack([rng.uniform(-reach, reach, (count, 2)), np.zeros(count)])
        antennas[0] = 0.0
        target = Target(primitives.plate(side, side, 2e-3), pose=placed((0, 0, -depth)))
        h = trial.simulate(target, MITO_BAND, Aperture(antennas))
        f = MITO_BAND.frequencies_hz
        error = np.abs(h - polygon_near(_corners(side, side, -depth), antennas, f))
        mirror = np.abs(infinite_plane(depth, f))
        yield CheckResult(
            f"plate {100 * side:g} cm at 0.4 m, edge 2 mm",
            f"worst complex error, {count} positions to 3 cm past its edge, of the mirror's echo",
            100 * worst(error / mirror), 1.0, "%", _EDGE_INTEGRAL, _FLAT_WHY, trial.mode,
        )  # fmt: skip


def plate_edge_scan(trial: Trial) -> Iterator[CheckResult]:
    """The antenna's foot point moves from the plate across its edge: the echo halves, it does not step."""
    side, depth = 0.12, 0.4
    offset = side / 2 + np.linspace(-0.04, 0.04, trial.pick(81, 41, 21))
    antennas = _row(offset)
    target = Target(primitives.plate(side, side), pose=placed((0, 0, -depth)))
    h = trial.simulate(target, MITO_BAND, Aperture(antennas))
    f = MITO_BAND.frequencies_hz
    truth = polygon_near(_corners(side, side, -depth), antennas, f)
    mirror = infinite_plane(depth, f)
    dense = side / 2 + np.linspace(-0.04, 0.04, 401)
    curve = polygon_near(_corners(side, side, -depth), _row(dense), f[:1])
    yield CheckResult(
        "plate 12 cm of two triangles at 0.4 m, foot point across its edge",
        f"worst complex error, {len(offset)} positions, of the mirror's echo",
        100 * worst(np.abs((h - truth) / mirror)), 1.0, "%", _EDGE_INTEGRAL, _FLAT_WHY, trial.mode,
        detail={
            "kind": "edge", "x": offset - side / 2, "measured_db": level_db(h[:, 0] / mirror[0]),
            "reference_x": dense - side / 2, "reference_db": level_db(curve[:, 0] / mirror[0]),
        },
    )  # fmt: skip


def disc_zones(trial: Trial) -> Iterator[CheckResult]:
    """Discs on their axis through several Fresnel zones, from twice the mirror's echo to nearly none."""
    for radius in (0.05,) if trial.quick else (0.03, 0.05):
        distance = np.linspace(0.3, 0.5, trial.pick(81, 41, 21))
        antennas = np.column_stack([np.zeros((len(distance), 2)), distance])
        h = trial.simulate(primitives.disc(radius, 1e-3), MITO_BAND, Aperture(antennas))
        d, f = distance[:, None], MITO_BAND.frequencies_hz
        truth, mirror = disc_near_axis(radius, d, f), infinite_plane(d, f)
        dense = np.linspace(0.3, 0.5, 401)
        curve = disc_near_axis(radius, dense, f[0]) / infinite_plane(dense, f[0])
        paraxial = disc_near_axis_paraxial(radius, d, f)
        yield CheckResult(
            f"disc a = {100 * radius:g} cm on its axis, edge 1 mm",
            f"worst complex error, {len(distance)} distances 0.3-0.5 m, of the mirror's echo",
            100 * worst(np.abs((h - truth) / mirror)), 1.0, "%",
            "physical optics of the disc by the exponential integral", _FLAT_WHY, trial.mode,
            detail={
                "kind": "disc", "radius_m": radius, "x": distance, "reference_x": dense,
                "measured_ratio": np.abs(h / mirror)[:, 0], "reference_ratio": np.abs(curve),
                "worst_percent_paraxial": 100 * worst(np.abs((paraxial - truth) / mirror)),
            },
        )  # fmt: skip
