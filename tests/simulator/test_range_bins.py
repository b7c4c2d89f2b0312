"""Range bins with moments: what falls between bin centres comes out with the right phase all the same."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waveformer.simulator import range_bins as module
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import NUM_MOMENTS, RangeBins, range_bins, reference_phase

CHIRP = Chirp(77e9, 4e9, 64)
CELL_RADIUS_M = 0.004


def spectrum_of(ranges: RangeBins, range_m: float, cell_m: float) -> np.ndarray:
    """The T samples of a unit echo at `range_m`, gathered in a cell centred on `cell_m`."""
    bins = np.zeros((ranges.count, NUM_MOMENTS), dtype=complex)
    nearest = round(cell_m / ranges.width_m)
    offset = (range_m - nearest * ranges.width_m) / ranges.moment_scale_m
    carrier = np.exp(-4j * np.pi / ranges.wavelength_m * range_m)
    bins[nearest + ranges.count // 2] = carrier * offset ** np.arange(NUM_MOMENTS)
    return bins.reshape(-1) @ ranges.to_samples


def exact(range_m: float) -> np.ndarray:
    return np.exp(-4j * np.pi * CHIRP.frequencies_hz * range_m / SPEED_OF_LIGHT_M_PER_S)


def bound(ranges: RangeBins) -> float:
    """Error of a cubic fit over the moment scale at the edge of the band, plus float32."""
    half_band = 0.5 * (CHIRP.frequencies_hz[-1] - CHIRP.frequencies_hz[0])
    phase = 4 * np.pi * half_band * ranges.moment_scale_m / SPEED_OF_LIGHT_M_PER_S
    return 2 * (phase / 2) ** NUM_MOMENTS / math.factorial(NUM_MOMENTS) + 1e-6


def test_an_echo_at_any_offset_comes_out_with_its_exact_phase_over_the_whole_band(
    rng: np.random.Generator,
) -> None:
    ranges = range_bins(CHIRP, np.zeros(3), 0.05, CELL_RADIUS_M)
    for cell_m in rng.uniform(-0.05, 0.05, 200):
        range_m = cell_m + rng.uniform(-CELL_RADIUS_M, CELL_RADIUS_M)
        assert np.abs(spectrum_of(ranges, range_m, cell_m) - exact(range_m)).max() < bound(ranges)
    assert bound(ranges) < 1e-3  # what the module promises


@pytest.mark.parametrize("side", [-1, 1])
def test_the_edges_of_a_bin_are_as_good_as_its_middle(side: int) -> None:
    ranges = range_bins(CHIRP, np.zeros(3), 0.05, CELL_RADIUS_M)
    for nearest in (-3, 0, 4):
        cell_m = (nearest + side * 0.4999999) * ranges.width_m
        range_m = cell_m + side * CELL_RADIUS_M
        assert np.abs(spectrum_of(ranges, range_m, cell_m) - exact(range_m)).max() < bound(ranges)


def test_a_bin_of_half_a_wavelength_does_not_resonate(monkeypatch: pytest.MonkeyPatch) -> None:
    # Bins half a wavelength apart repeat the two-way carrier: errors of all bins would add up in phase.
    monkeypatch.setattr(module, "BIN_WIDTH_WAVELENGTHS", 0.5)
    ranges = range_bins(CHIRP, np.zeros(3), 0.05, CELL_RADIUS_M)
    assert ranges.width_m == pytest.approx(SPEED_OF_LIGHT_M_PER_S / CHIRP.center_hz / 2)
    positions_m = np.arange(-20, 20) * ranges.width_m + 0.25 * ranges.width_m
    total = sum(spectrum_of(ranges, range_m, range_m) for range_m in positions_m)
    expected = sum(exact(range_m) for range_m in positions_m)
    assert np.abs(total - expected).max() < len(positions_m) * bound(ranges)


def test_the_bin_width_does_not_show_in_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    for width in (0.3, 0.5, 1.0, 1.4):
        monkeypatch.setattr(module, "BIN_WIDTH_WAVELENGTHS", width)
        ranges = range_bins(CHIRP, np.zeros(3), 0.05, CELL_RADIUS_M)
        assert np.abs(spectrum_of(ranges, 0.0313, 0.03) - exact(0.0313)).max() < bound(ranges)


def test_the_bins_cover_the_object_with_room_at_both_ends() -> None:
    for radius_m in (0.0, 1e-4, 0.05, 1.0):
        ranges = range_bins(CHIRP, np.zeros(3), radius_m, CELL_RADIUS_M)
        assert ranges.count % 2 == 1
        assert (ranges.count // 2 - 0.5) * ranges.width_m > radius_m
        assert ranges.to_samples.shape == (ranges.count * NUM_MOMENTS, CHIRP.num_samples)


@pytest.mark.parametrize("num_samples", [2, 3, 16, 64, 100, 511])
def test_the_reference_phase_equals_the_plain_exponential(rng: np.random.Generator, num_samples: int) -> None:
    chirp = Chirp(77e9, 4e9, num_samples)
    center = np.array([0.02, -0.03, -0.45])
    tx_m = rng.uniform(-0.1, 0.1, (7, 3))
    rows = np.array([5, 0, 3])
    for rx_m in (None, rng.uniform(-0.1, 0.1, (7, 3))):
        aperture = Aperture(tx_m, rx_m)
        path = np.linalg.norm(tx_m - center, axis=1) + np.linalg.norm(aperture.receivers_m - center, axis=1)
        delay_s = path[rows] / SPEED_OF_LIGHT_M_PER_S
        expected = np.exp(-2j * np.pi * chirp.frequencies_hz * delay_s[:, None])
        phase = reference_phase(chirp, aperture, rows, center)
        assert phase.dtype == np.complex64
        assert np.abs(phase - expected).max() < 2e-7  # float32 of a unit phasor


def test_the_reference_phase_keeps_its_accuracy_far_away() -> None:
    aperture = Aperture(np.zeros((1, 3)))
    for distance_m in (0.3, 20.0, 500.0):
        phase = reference_phase(CHIRP, aperture, np.array([0]), np.array([0.0, 0.0, -distance_m]))
        # float32 output, and float64 of 4 pi f d / c = 1.7e6 rad at 500 m
        assert np.abs(phase[0] - exact(distance_m)).max() < 3e-7
