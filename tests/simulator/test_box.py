"""A closed box through the public simulator, in both modes: nothing of it, its loss, its walls, and what lies beyond."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator import primitives
from waveformer.simulator.forward import simulate
from waveformer.simulator.materials import Material
from waveformer.simulator.occluders import Box
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.slab import refraction_factor, slab_transmission
from waveformer.simulator.target import Target
from waveformer.simulator.validation_walls import wall_echo

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77.5001e9, 3.0009e9, 32)
LOW, HIGH = (-0.06, -0.07, -0.5), (0.06, 0.07, -0.3)
MODES = ("fast", "exact")
# 50 dB and more below any wall: it stands in for no object at all
SLIVER = primitives.plate(1e-3, 1e-5)


def at(mesh: Any, *place: float, material: Material | None = None) -> Target:
    pose = np.eye(4)
    pose[:3, 3] = place
    return Target(mesh, material or Material.pec(), pose)


def echo(target: Any, aperture: Aperture, **scene: Any) -> np.ndarray:
    return np.asarray(simulate(target, CHIRP, aperture, **scene).h, dtype=complex)


@pytest.mark.parametrize("mode", MODES)
def test_a_box_of_permittivity_one_vanishes(rng: np.random.Generator, mode: str) -> None:
    """Asked: below -60 dB of the object; in pairs, with an object that shows edges through lid and sides."""
    tx = np.column_stack([rng.uniform(-0.15, 0.15, (6, 2)), np.zeros(6)])
    aperture = Aperture(tx, tx + [0.008, 0.0, 0.0])
    target = at(primitives.plate(0.04, 0.04), 0.0, 0.0, -0.4)
    bare = echo(target, aperture, mode=mode)
    boxed = echo(target, aperture, mode=mode, box=Box(LOW, HIGH, 0.005, 1.0))
    assert np.abs(boxed - bare).max() < 1e-3 * np.abs(bare).max()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["cardboard", "abs"])
def test_what_stands_inside_loses_what_the_lid_takes(mode: str, name: str) -> None:
    """Gated in range: lid and bottom are 30 cm away, and the object hides a part of the bottom."""
    box = Box((-0.08, -0.08, -0.8), (0.08, 0.08, -0.2), 0.003, name)
    aperture = Aperture([[0.0, 0.0, 0.0]])
    target = at(primitives.disc(0.006, 1e-3), 0.0, 0.0, -0.5)
    boxed, bare = (echo(target, aperture, mode=mode, **scene) for scene in ({"box": box}, {}))
    f = CHIRP.frequencies_hz
    assert box.material.permittivity is not None
    eps = np.array([box.material.permittivity.at(g) for g in f])
    lid = slab_transmission(eps, 0.003, 1.0, f).s * refraction_factor(eps, 0.003, 1.0, 0.5, f)
    gate = np.abs(np.arange(2048) / 2048 * CHIRP.unambiguous_range_m - 0.5) < 0.1
    found, expected = (np.fft.ifft(h * np.blackman(34)[1:-1], 2048)[0, gate] for h in (boxed, bare * lid**2))
    # asked of a sphere in a box: 0.3 dB, 3 % of the field; the window's sidelobes of both walls leave 1 %
    assert np.abs(found - expected).max() < 0.03 * np.abs(expected).max()


@pytest.mark.parametrize(("mode", "tolerance"), [("fast", 3e-3), ("exact", 2e-3)])
def test_the_walls_return_what_dense_integrals_say(mode: str, tolerance: float) -> None:
    """Lid, bottom and sides, from over the lid, of the strongest echo."""
    box = Box(LOW, HIGH, 0.003, 2.7 - 0.022j)
    antennas = np.array([[0.0, 0.0, 0.0], [0.045, -0.03, 0.0], [-0.02, 0.055, 0.0]])
    h = echo(at(SLIVER, 0.0, 0.0, -0.4), Aperture(antennas), mode=mode, box=box)[:, [0, 31]]
    truth = wall_echo(box, antennas, CHIRP.frequencies_hz[[0, 31]])
    # rectangles of a wavelength by second order of their size, the sliver, interpolation by 1e-3
    assert np.abs(h - truth).max() < tolerance * np.abs(truth).max()


@pytest.mark.parametrize("mode", MODES)
def test_beyond_the_box_both_walls_are_crossed(mode: str) -> None:
    box = Box((-0.06, -0.07, -0.4), HIGH, 0.004, "cardboard")
    aperture = Aperture([[0.0, 0.0, 0.0]])
    target = at(primitives.disc(0.003, 1e-3), 0.0, 0.0, -0.45)
    walls = echo(at(SLIVER, 0, 0, -0.45), aperture, mode=mode, box=box)
    ratio = (echo(target, aperture, mode=mode, box=box) - walls) / echo(target, aperture, mode=mode)
    f = CHIRP.frequencies_hz
    assert box.material.permittivity is not None
    eps = np.array([box.material.permittivity.at(g) for g in f])
    wall = slab_transmission(eps, 0.004, 1.0, f).s * refraction_factor(eps, 0.004, 1.0, 0.45, f)
    assert np.abs(20 * np.log10(np.abs(ratio / wall**4))).max() < 0.1


def test_beside_the_box_nothing_is_crossed() -> None:
    box, aperture = Box(LOW, HIGH, 0.004, "cardboard"), Aperture([[0.3, 0.0, 0.0]])
    target = at(primitives.disc(0.003, 1e-3), 0.3, 0.0, -0.4)
    walls = echo(at(SLIVER, 0.3, 0, -0.4), aperture, box=box)
    alone = echo(target, aperture)
    # the sliver is 46 dB below the disc
    assert np.abs(echo(target, aperture, box=box) - walls - alone).max() < 0.01 * np.abs(alone).max()


@pytest.mark.parametrize("mode", MODES)
def test_walls_are_reciprocal(rng: np.random.Generator, mode: str) -> None:
    tx = np.column_stack([rng.uniform(-0.05, 0.05, (5, 2)), np.zeros(5)])
    rx = tx + [0.03, -0.02, 0.0]
    how: dict[str, Any] = {"mode": mode, "box": Box(LOW, HIGH, 0.003, "abs")}
    there = echo(at(SLIVER, 0, 0, -0.4), Aperture(tx, rx), **how)
    back = echo(at(SLIVER, 0, 0, -0.4), Aperture(rx, tx), **how)
    # an identity of the integral: single-precision rounding
    assert np.abs(there - back).max() < 1e-5 * np.abs(there).max()


def test_the_size_of_a_tile_changes_nothing() -> None:
    aperture = Aperture.planar_grid(9, 9, 0.01)
    how: dict[str, Any] = {"box": Box(LOW, HIGH, 0.003, "cardboard")}
    target = at(primitives.disc(0.02, 2e-3), 0.0, 0.0, -0.4)
    whole = echo(target, aperture, **how)
    small = echo(target, aperture, tile_positions=10, **how)
    # other tiles have other nodes of interpolation, good to 1e-3
    assert np.abs(whole - small).max() < 2e-3 * np.abs(whole).max()
