"""Validation of sheets: echoes behind them against the plane-wave spectrum, and the sheet's own echo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waveformer.simulator import primitives
from waveformer.simulator.arrays import with_receivers
from waveformer.simulator.closed_forms import infinite_plane
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.permittivity import lookup_permittivity
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.sheet_spectrum import spectrum_transmission
from waveformer.simulator.slab import slab_reflection
from waveformer.simulator.target import Target
from waveformer.simulator.validation_result import (
    MITO_BAND,
    CheckResult,
    ComplexArray,
    Trial,
    level_db,
    phase_deg,
    placed,
    worst,
)
from waveformer.simulator.validation_spectrum import plate_behind_sheet

_DISTANCE_M = 0.35
_MATERIALS = (("cardboard", 5e-3), ("abs", 3e-3), ("wood", 10e-3))
_FIELDS = (("s", (0.0, 1.0, 0.0)), ("p", (1.0, 0.0, 0.0)))
_SPECTRUM = "plane-wave spectrum of the point source behind the sheet, both ways"
# Every n-th sample of the chirp, its ends included but one
_STRIDE = 9


def sheet_transmission(trial: Trial) -> Iterator[CheckResult]:
    """A disc that faces the radar behind a sheet, over the disc alone, the sheet turned up to 45 degrees."""
    disc, radar = (
        Target(primitives.disc(2e-3, 1e-3), pose=placed((0, 0, -_DISTANCE_M))),
        Aperture(np.zeros((1, 3))),
    )
    bare = trial.simulate(disc, MITO_BAND, radar)[0, ::_STRIDE]
    materials = _MATERIALS[1:] if trial.quick else _MATERIALS
    for title, angles, max_db, max_deg in (
        ("at normal incidence", (0,), 0.05, 1.0),
        ("at 15 to 45 deg", (30, 45) if trial.quick else (15, 30, 45), 0.1, 2.0),
    ):
        level, phase = {}, {}
        for name, thickness in materials:
            for degrees in angles:
                for way, (polarization, field) in enumerate(_FIELDS):
                    angle = np.radians(degrees)
                    sheet = Sheet((0, 0, -0.15), (np.sin(angle), 0, np.cos(angle)), thickness, name)
                    h = trial.simulate(disc, MITO_BAND, radar, sheets=sheet, polarization=field)[0, ::_STRIDE]
                    ratio = h / bare / _point_transmission(name, thickness, angle)[way] ** 2
                    case = f"{name} {1e3 * thickness:g} mm {degrees} deg {polarization}"
                    level[case], phase[case] = worst(level_db(ratio)), worst(phase_deg(ratio))
        setup = f"disc 4 mm at {_DISTANCE_M:g} m behind {', '.join(n for n, _ in materials)} {title}"
        yield CheckResult(
            setup, "worst level error of the two-way transmission, s and p", max(level.values()), max_db, "dB",
            _SPECTRUM, "first order of thickness over distance; inner echoes walk off further", trial.mode, detail=level,
        )  # fmt: skip
        yield CheckResult(
            setup, "worst phase error of the two-way transmission, s and p", max(phase.values()), max_deg, "deg",
            _SPECTRUM, "as for the level", trial.mode, detail=phase,
        )  # fmt: skip


def sheet_under_aperture(trial: Trial) -> Iterator[CheckResult]:
    """A plate behind a slanted sheet, scanned with four receivers: one at a time may be right and a scan wrong."""
    if trial.quick and trial.mode == "exact":
        return
    side, depth, chirp = 0.04, -0.35, Chirp(MITO_BAND.start_hz, MITO_BAND.bandwidth_hz, 16)
    count = trial.pick(24, 16, 6)
    aperture = with_receivers(Aperture.planar_grid(count, count, 0.16 / count), "mito")
    sheet = Sheet((0, 0, -0.2), (0.25, -0.15, 1.0), 5e-3, "cardboard")
    plate = Target(primitives.plate(side, side, 2e-3), pose=placed((0, 0, depth)))
    h = trial.simulate(plate, chirp, aperture, sheets=sheet)
    rows = trial.rng("sheet under aperture").choice(len(aperture), trial.pick(60, 20, 20), replace=False)
    samples = np.array([0, 8, 15])
    some = Aperture(aperture.tx_m[rows], aperture.receivers_m[rows])
    truth = plate_behind_sheet(side, depth, sheet, some, chirp.frequencies_hz[samples])
    error = h[np.ix_(rows, samples)] - truth
    strongest = np.abs(truth).max()
    name = f"plate 4 cm at 0.35 m behind slanted cardboard, {count} x {count} positions x 4 receivers"
    yield CheckResult(
        name, f"worst complex error, {len(rows)} pairs, of the strongest echo", 100 * worst(np.abs(error)) / strongest, 1.0, "%",
        "Gauss-Legendre integral of physical optics with the plane-wave spectrum on each way",
        "as for flat bodies in the open: 1 % is 0.09 dB", trial.mode,
    )  # fmt: skip
    there = trial.simulate(plate, chirp, some, sheets=sheet)
    back = trial.simulate(plate, chirp, Aperture(some.receivers_m, some.tx_m), sheets=sheet)
    yield CheckResult(
        name, f"largest change when {len(rows)} transmitters and receivers are swapped",
        worst(np.abs(back - there)) / worst(np.abs(there)), 1e-5, "relative", "reciprocity",
        "an identity of the integral: only single-precision rounding is left", trial.mode,
    )  # fmt: skip


def sheet_own_echo(trial: Trial) -> Iterator[CheckResult]:
    """The sheet's own echo: an image of the antenna, weakened by the slab's reflection."""
    # A sliver 50 dB and more below the sheet stands in for no object at all
    sliver, distance = Target(primitives.plate(1e-3, 1e-5), pose=placed((0, 0, -0.4))), 0.2
    apart = np.array([0.0, 0.01, 0.05, 0.1])
    tx, f = np.column_stack([np.linspace(-0.05, 0.05, 4), np.zeros((4, 2))]), MITO_BAND.frequencies_hz
    aperture = Aperture(tx, tx + apart[:, None] * [1.0, 0.0, 0.0])
    path = np.hypot(distance, apart / 2)[:, None]
    level, phase = {}, {}
    for name, thickness in _MATERIALS[1:2] if trial.quick else _MATERIALS:
        sheet = Sheet((0, 0, -distance), (0, 0, 1), thickness, name, echo=True)
        h = trial.simulate(sliver, MITO_BAND, aperture, sheets=sheet)
        h = h - trial.simulate(
            sliver, MITO_BAND, aperture, sheets=Sheet((0, 0, -distance), (0, 0, 1), thickness, name)
        )
        eps = np.array([lookup_permittivity(name).at(g) for g in f])
        # transmitter and receiver along x, the field along y: s waves
        truth = infinite_plane(path, f, 1.0) * slab_reflection(eps, thickness, distance / path, f).s
        level[name], phase[name] = worst(level_db(h / truth)), worst(phase_deg(h / truth))
    setup = f"sheet of {', '.join(level)} at {distance:g} m, transmitter and receiver to 10 cm apart"
    yield CheckResult(
        setup, "worst level error of its own echo", max(level.values()), 0.05, "dB",
        "image law x reflection of the slab", "an identity but for interpolation over the band, 1e-3", trial.mode,
        detail=level,
    )  # fmt: skip
    yield CheckResult(
        setup, "worst phase error of its own echo", max(phase.values()), 1.0, "deg",
        "image law x reflection of the slab", "as for the level", trial.mode, detail=phase,
    )  # fmt: skip


def _point_transmission(name: str, thickness_m: float, angle_rad: float) -> tuple[ComplexArray, ComplexArray]:
    """One-way transmission to the disc over the band, s and p, each (F,)."""
    lateral, height = _DISTANCE_M * np.sin(angle_rad), _DISTANCE_M * np.cos(angle_rad)
    values = [
        spectrum_transmission(lookup_permittivity(name).at(f), thickness_m, lateral, height, f)
        for f in MITO_BAND.frequencies_hz[::_STRIDE]
    ]
    return np.array([v.s[0] for v in values]), np.array([v.p[0] for v in values])
