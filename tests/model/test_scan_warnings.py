"""What spoils a scan is said before anybody looks at its image."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from waveformer.model.scan_warnings import scan_warnings
from waveformer.simulator import Aperture, Chirp, Measurement

CHIRP = Chirp(77.5001e9, 3.0009e9, 32)


def scan(tx_m: NDArray[np.float64], rng: np.random.Generator) -> Measurement:
    h = rng.standard_normal((len(tx_m), 32, 2)) @ [1.0, 1.0j]
    return Measurement(h, CHIRP, Aperture(tx_m))


@pytest.mark.parametrize("pitch_m", [0.002, 0.004])
def test_a_fine_raster_is_fine(pitch_m: float, rng: np.random.Generator) -> None:
    assert scan_warnings(scan(Aperture.planar_grid(30, 40, pitch_m).tx_m, rng)) == ()


def test_four_receivers_at_each_place_are_fine(rng: np.random.Generator) -> None:
    tx = np.repeat(Aperture.planar_grid(30, 40, 0.004).tx_m, 4, axis=0)
    rx = tx + np.tile(
        np.array([[-0.0108, 0, 0], [-0.0089, 0, 0], [-0.0069, 0, 0], [-0.005, 0, 0]]), (1200, 1)
    )
    h = rng.standard_normal((len(tx), 32, 2)) @ [1.0, 1.0j]
    assert scan_warnings(Measurement(h, CHIRP, Aperture(tx, rx))) == ()


def test_a_coarse_raster_is_named(rng: np.random.Generator) -> None:
    (warning,) = scan_warnings(scan(Aperture.planar_grid(20, 20, 0.008).tx_m, rng))
    assert "8.0 mm apart" in warning


def test_a_random_sparse_aperture_is_named(rng: np.random.Generator) -> None:
    warnings = scan_warnings(scan(np.pad(rng.uniform(-0.15, 0.15, (800, 2)), ((0, 0), (0, 1))), rng))
    assert any("mm apart" in warning for warning in warnings)
    assert any("irregularly" in warning for warning in warnings)


def test_a_jittered_raster_is_named(rng: np.random.Generator) -> None:
    tx = Aperture.planar_grid(40, 40, 0.004).tx_m
    tx = tx + np.pad(rng.uniform(-0.0018, 0.0018, (len(tx), 2)), ((0, 0), (0, 1)))
    (warning,) = scan_warnings(scan(tx, rng))
    assert "irregularly" in warning


def test_saturation_is_named(rng: np.random.Generator) -> None:
    good = scan(Aperture.planar_grid(30, 40, 0.004).tx_m, rng)
    clipped = np.clip(good.h.real, -0.5, 0.5) + 1j * np.clip(good.h.imag, -0.5, 0.5)
    (warning,) = scan_warnings(Measurement(clipped, CHIRP, good.aperture))
    assert "saturated" in warning


def test_a_single_antenna_and_a_line_do_not_fail(rng: np.random.Generator) -> None:
    assert scan_warnings(scan(np.zeros((1, 3)), rng)) == ()
    assert scan_warnings(scan(Aperture.planar_grid(50, 1, 0.002).tx_m, rng)) == ()
