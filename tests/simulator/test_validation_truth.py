"""The references that validation computes itself, against what is known without them."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.closed_forms import polygon_near
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.radar import Aperture
from waveformer.simulator.sheet_spectrum import spectrum_transmission
from waveformer.simulator.slab import slab_reflection
from waveformer.simulator.validation_result import MITO_BAND
from waveformer.simulator.validation_spectrum import plate_behind_sheet
from waveformer.simulator.validation_walls import wall_echo

FREQUENCIES_HZ = MITO_BAND.frequencies_hz[[0, 40]]
ANTENNAS = np.array([[0.0, 0.0, 0.0], [0.05, -0.03, 0.0], [-0.08, 0.06, 0.0]])


def square(side_m: float, z: float) -> list[list[float]]:
    x = side_m / 2
    return [[-x, -x, z], [x, -x, z], [x, x, z], [-x, x, z]]


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.25, -0.15, 1.0)])
def test_a_plate_behind_nothing_is_the_plate(normal: tuple[float, float, float]) -> None:
    sheet = Sheet((0, 0, -0.2), normal, 5e-3, 1.0)
    h = plate_behind_sheet(0.04, -0.35, sheet, Aperture(ANTENNAS), FREQUENCIES_HZ)
    truth = polygon_near(square(0.04, -0.35), ANTENNAS, FREQUENCIES_HZ)
    # Gauss' rule on one side, edge integrals on the other
    assert np.abs(h - truth).max() < 1e-6 * np.abs(truth).max()


def test_a_small_plate_has_the_spectrum_of_its_middle() -> None:
    sheet = Sheet((0, 0, -0.2), (0.4, 0.0, 1.0), 5e-3, "wood")
    pairs = Aperture(ANTENNAS[:1], ANTENNAS[:1])
    bare = plate_behind_sheet(1e-4, -0.35, Sheet((0, 0, -0.2), (0, 0, 1), 5e-3, 1.0), pairs, FREQUENCIES_HZ)
    ratio = plate_behind_sheet(1e-4, -0.35, sheet, pairs, FREQUENCIES_HZ) / bare
    angle = np.arctan(0.4)
    assert sheet.material.permittivity is not None
    for column, f in enumerate(FREQUENCIES_HZ):
        eps = sheet.material.permittivity.at(f)
        one_way = spectrum_transmission(eps, 5e-3, 0.35 * np.sin(angle), 0.35 * np.cos(angle), f)
        # the field along y lies across the plane of incidence; the plate spans 0.02 deg
        assert ratio[0, column] == pytest.approx(one_way.s[0] ** 2, rel=1e-5)


def test_an_opaque_box_is_its_lid() -> None:
    box = Box((-0.06, -0.07, -0.5), (0.06, 0.07, -0.3), 0.02, 6 - 3j)
    h = wall_echo(box, ANTENNAS[:2], FREQUENCIES_HZ)
    lid = [[-0.06, -0.07, -0.3], [0.06, -0.07, -0.3], [0.06, 0.07, -0.3], [-0.06, 0.07, -0.3]]
    slab = slab_reflection(6 - 3j, 0.02, 1.0, FREQUENCIES_HZ).s
    truth = -slab * polygon_near(lid, ANTENNAS[:2], FREQUENCIES_HZ)
    # the lid's edges are seen at up to 25 deg, where s and p differ by some percent of the little they return
    assert np.abs(h - truth).max() < 5e-3 * np.abs(truth).max()


def test_a_box_of_nothing_returns_nothing() -> None:
    box = Box((-0.06, -0.07, -0.5), (0.06, 0.07, -0.3), 0.005, 1.0)
    assert np.abs(wall_echo(box, ANTENNAS[:1], FREQUENCIES_HZ[:1])).max() < 1e-12
