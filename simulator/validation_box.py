"""Validation of closed boxes: a box of nothing, the level of an object inside, and the walls' own echo."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waveformer.simulator import primitives
from waveformer.simulator.closed_forms import infinite_plane, polygon_near
from waveformer.simulator.interpolation import chebyshev_points, lagrange_weights
from waveformer.simulator.occluders import Box
from waveformer.simulator.permittivity import lookup_permittivity
from waveformer.simulator.radar import Aperture
from waveformer.simulator.sheet_spectrum import spectrum_transmission
from waveformer.simulator.slab import slab_reflection
from waveformer.simulator.target import Target
from waveformer.simulator.validation_result import (
    MITO_BAND,
    CheckResult,
    ComplexArray,
    FloatArray,
    Trial,
    level_db,
    placed,
    worst,
)
from waveformer.simulator.validation_walls import wall_echo

# Sidelobes of Blackman's window lie below -58 dB, its main lobe is six bins wide
_GATE_M = 0.15
_ZERO_PADDING = 32
_BAND_NODES = 8


def box_of_nothing(trial: Trial) -> Iterator[CheckResult]:
    """Walls of permittivity 1 change nothing and return nothing."""
    center, count = np.array([0.0, 0.0, -0.4]), trial.pick(16, 8, 4)
    lateral = trial.rng("box of nothing").uniform(-0.08, 0.08, (count, 2))
    aperture = Aperture(np.column_stack([lateral, np.zeros(count)]))
    target = Target(primitives.sphere(0.03, 1.4e-3), pose=placed(center))
    bare = trial.simulate(target, MITO_BAND, aperture)
    boxed = trial.simulate(
        target, MITO_BAND, aperture, box=Box((-0.06, -0.07, -0.5), (0.06, 0.07, -0.3), 5e-3, 1.0)
    )
    yield CheckResult(
        "sphere a = 3 cm in a closed box 12 x 14 x 20 cm of permittivity 1, walls 5 mm",
        f"largest difference from no box, {count} positions, of the strongest echo",
        100 * worst(np.abs(boxed - bare)) / worst(np.abs(bare)), 0.1, "%", "the same sphere without a box",
        "-60 dB; only rounding is left", trial.mode,
        detail={"level_db": 20 * np.log10(worst(np.abs(boxed - bare)) / worst(np.abs(bare)))},
    )  # fmt: skip


def sphere_in_box(trial: Trial) -> Iterator[CheckResult]:
    """A sphere in a cardboard box keeps its level, less the slab's loss, once the walls are gated out in range."""
    if trial.quick and trial.mode == "exact":
        return
    radius, depth, thickness = 0.03, 0.53, 5e-3
    count = trial.pick(9, 5, 3)
    antennas = np.column_stack([np.linspace(-0.06, 0.06, count), np.zeros((count, 2))])
    target = Target(primitives.sphere(radius, 1.05e-3), pose=placed((0, 0, -depth)))
    box = Box((-0.1, -0.1, -0.8), (0.1, 0.1, -0.2), thickness, "cardboard")
    bare = trial.simulate(target, MITO_BAND, Aperture(antennas))
    boxed = trial.simulate(target, MITO_BAND, Aperture(antennas), box=box)
    front_m = np.hypot(antennas[:, 0], depth) - radius
    direction = np.column_stack([-antennas[:, 0], np.zeros(count), np.full(count, -depth)])
    legs = direction * (front_m / np.hypot(antennas[:, 0], depth))[:, None]
    through = np.array([_transmission("cardboard", thickness, abs(leg[0]), abs(leg[2])) for leg in legs])
    peaks = [_gated_peak(h, front_m) for h in (boxed, bare * through**2, bare)]
    yield CheckResult(
        "sphere a = 3 cm at 0.5 m in a closed cardboard box, lid at 0.2 m, bottom at 0.8 m",
        f"worst level error of its peak in the gated range profile, {count} positions", worst(level_db(peaks[0] / peaks[1])),
        0.3, "dB", "the same sphere without a box x two-way plane-wave spectrum through the lid",
        "what the walls' sidelobes leave in the gate, -58 dB of echoes 10 to 20 dB stronger", trial.mode,
        detail={"level_db": float(level_db(peaks[0] / peaks[2]).mean())},
    )  # fmt: skip


def box_walls(trial: Trial) -> Iterator[CheckResult]:
    """The echo of an empty box: of its lid alone, and of all walls."""
    # A sliver 50 dB and more below the walls stands in for no object at all
    sliver = Target(primitives.plate(1e-3, 1e-5), pose=placed((0, 0, -0.4)))
    count, low, high = trial.pick(8, 6, 3), (-0.06, -0.07, -0.5), (0.06, 0.07, -0.3)
    lateral = trial.rng("box walls").uniform(-0.05, 0.05, (count, 2))
    antennas = np.column_stack([lateral, np.zeros(count)])
    absorber = Box(low, high, 0.02, 6 - 3j)
    f = MITO_BAND.frequencies_hz
    h = trial.simulate(sliver, MITO_BAND, Aperture(antennas), box=absorber)
    lid = [[low[0], low[1], high[2]], [high[0], low[1], high[2]], high, [low[0], high[1], high[2]]]
    slab = slab_reflection(6 - 3j, absorber.thickness_m, 1.0, f).s
    why = "as for flat bodies in the open: 1 % is 0.09 dB"
    yield CheckResult(
        "empty closed box 12 x 14 x 20 cm of thick absorber, lid at 0.3 m",
        f"worst complex error, {count} positions over the lid, of an infinite lid's echo",
        100 * worst(np.abs(h + slab * polygon_near(lid, antennas, f)) / np.abs(slab * infinite_plane(0.3, f))), 1.0, "%",
        "reflection of the slab at normal incidence x physical optics of the lid as an edge integral", why, trial.mode,
    )  # fmt: skip
    if trial.quick:
        return
    permittivity = lookup_permittivity("abs").at(MITO_BAND.center_hz)
    box, few, samples = Box(low, high, 3e-3, permittivity), antennas[:3], np.array([0, 40])
    h = trial.simulate(sliver, MITO_BAND, Aperture(few), box=box)[:, samples]
    scale = (
        infinite_plane(0.3, f[samples]) * slab_reflection(permittivity, box.thickness_m, 1.0, f[samples]).s
    )
    yield CheckResult(
        "empty closed box 12 x 14 x 20 cm of 3 mm abs, lid at 0.3 m",
        f"worst complex error, {len(few)} positions over the lid, of an infinite lid's echo",
        100 * worst(np.abs(h - wall_echo(box, few, f[samples])) / np.abs(scale)), 1.0, "%",
        "Gauss-Legendre integrals over lid, bottom and sides, reflection and lid at the local angle", why, trial.mode,
    )  # fmt: skip


def _transmission(name: str, thickness_m: float, lateral_m: float, height_m: float) -> ComplexArray:
    """One way through a level wall, s waves, (T,); interpolated over the band, which changes it by 1e-6."""
    permittivity, nodes = lookup_permittivity(name), chebyshev_points(_BAND_NODES)
    f = MITO_BAND.frequencies_hz
    half_band = (f[-1] - f[0]) / 2
    values = [
        spectrum_transmission(permittivity.at(g), thickness_m, lateral_m, height_m, g).s[0]
        for g in f[0] + half_band * (nodes + 1)
    ]
    return np.asarray(lagrange_weights(nodes, (f - f[0]) / half_band - 1) @ np.array(values))


def _gated_peak(h: ComplexArray, range_m: FloatArray) -> ComplexArray:
    """Strongest value of the range profile within the gate about a range, per position, (N,)."""
    count = _ZERO_PADDING * h.shape[1]
    profile = np.fft.ifft(h * np.blackman(h.shape[1] + 2)[1:-1], count, axis=1)
    at_m = np.arange(count) / _ZERO_PADDING * MITO_BAND.range_bin_m
    gated = np.where(np.abs(at_m - range_m[:, None]) < _GATE_M, np.abs(profile), 0.0)
    return np.asarray(gated.max(axis=1), dtype=complex)
