"""The histogram kernel against a plain sum over points and frequencies."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.model import range_response, reference_range_response
from waveformer.model.range_response import range_limits, range_responses
from waveformer.model.range_window import measured_profiles, mmnorm_window, object_window
from waveformer.model.surfaces import SurfaceStack
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.points import simulate_points
from waveformer.simulator.radar import Aperture, Chirp

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77.5001e9, 3.0009e9, 64)
NUM_LEVELS = 5


def some_stack(rng: np.random.Generator, num_points: int = 400) -> SurfaceStack:
    """Scattered points, some facing away; level 3 of 5 is empty."""
    normals = rng.normal(size=(num_points, 3)) + (0, 0, 1.0)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    level = np.sort(rng.choice([0, 1, 2, 4], num_points))
    points = rng.uniform([-0.05, -0.05, -0.45], [0.05, 0.05, -0.38], (num_points, 3))
    return SurfaceStack(points, normals, rng.uniform(0.5e-6, 2e-6, num_points), level)


def some_antennas(rng: np.random.Generator, is_bistatic: bool) -> tuple[np.ndarray, np.ndarray | None]:
    tx_m = rng.uniform([-0.15, -0.2, 0], [0.15, 0.2, 0.001], (13, 3))
    return tx_m, tx_m + rng.uniform(-0.03, 0.03, (13, 3)) if is_bistatic else None


@pytest.mark.parametrize("window_name", ["object", "mmnorm"])
@pytest.mark.parametrize("is_bistatic", [False, True])
@pytest.mark.parametrize("coherent", [True, False])
def test_kernel_equals_the_sum_over_points_and_frequencies(
    rng: np.random.Generator, coherent: bool, is_bistatic: bool, window_name: str
) -> None:
    stack = some_stack(rng)
    tx_m, rx_m = some_antennas(rng, is_bistatic)
    low, high = stack.points_m.min(axis=0), stack.points_m.max(axis=0)
    if window_name == "object":
        window = object_window(CHIRP, *range_limits(low, high, tx_m, rx_m))
    else:
        window = mmnorm_window(CHIRP, len(tx_m))
    arguments = (stack, NUM_LEVELS, tx_m, rx_m, CHIRP, window, coherent)
    fast, slow = range_responses(*arguments), reference_range_response.range_responses(*arguments)
    assert fast.shape == slow.shape == (NUM_LEVELS, 13, window.bins.shape[1])
    assert fast.dtype == (np.complex64 if coherent else np.float32)
    # At most 0.02 rad per point (bins of 0.7 mm), random in sign: 0.01 of the strongest bin.
    assert np.abs(fast - slow).max() < 0.01 * np.abs(slow).max()
    assert not fast[3].any()
    assert np.abs(slow[[0, 1, 2, 4]]).max(axis=(1, 2)).min() > 0


def test_the_kernel_is_the_echo_of_points() -> None:
    point = np.array([[0.02, -0.01, -0.41]])
    aperture = Aperture(
        np.array([[0.0, 0.0, 0.0], [0.1, -0.15, 0.0]]), np.array([[0.01, 0, 0], [0.1, -0.14, 0]])
    )
    scan = simulate_points(point, 1.0, CHIRP, aperture)
    stack = SurfaceStack(point, np.array([[0, 0, 1.0]]), np.array([1.0]), np.array([0]))
    window = object_window(CHIRP, *range_limits(point[0], point[0], aperture.tx_m, aperture.rx_m))
    simulated = range_responses(stack, 1, aperture.tx_m, aperture.rx_m, CHIRP, window)[0]
    # an echo in proportion to the wavelength, which the surface sum is not
    scan = Measurement(scan.h / CHIRP.wavelengths_m, CHIRP, aperture)
    factor = measured_profiles(scan, np.arange(2), window) / simulated
    assert np.abs(np.angle(factor)).max() < 1e-3  # the phase is that of the echo, in single precision
    ways = [side - point[0] for side in (aperture.tx_m, aperture.receivers_m)]
    cosine = np.mean([way[:, 2] / np.linalg.norm(way, axis=1) for way in ways], axis=0)
    expected = np.tile((4 * np.pi) ** -1.5 / cosine[:, None], window.bins.shape[1])
    assert np.abs(factor) == pytest.approx(expected, rel=0.03)  # 0.7 mm bins move an echo by 0.35 mm of 50


def test_blocks_of_antennas_do_not_show(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    stack = some_stack(rng)
    tx_m, _ = some_antennas(rng, False)
    window = object_window(CHIRP, *range_limits(stack.points_m.min(0), stack.points_m.max(0), tx_m, None))
    whole = range_responses(stack, NUM_LEVELS, tx_m, None, CHIRP, window)
    monkeypatch.setattr(range_response, "_MAX_HISTOGRAM_VALUES", 1)
    one_by_one = range_responses(stack, NUM_LEVELS, tx_m, None, CHIRP, window)
    assert np.abs(whole - one_by_one).max() < 1e-6 * np.abs(whole).max()  # order of a BLAS sum


def test_powers_do_not_depend_on_the_sampling(rng: np.random.Generator) -> None:
    coarse = some_stack(rng)
    twice = [np.repeat(values, 2, axis=0) for values in (coarse.points_m, coarse.normals, coarse.areas_m2)]
    fine = SurfaceStack(twice[0], twice[1], twice[2] / 2, np.repeat(coarse.level, 2))
    tx_m, _ = some_antennas(rng, False)
    window = mmnorm_window(CHIRP, len(tx_m))
    both = [range_responses(s, NUM_LEVELS, tx_m, None, CHIRP, window, False) for s in (coarse, fine)]
    assert both[0] == pytest.approx(both[1], rel=1e-5)  # float32


def test_range_limits_bound_every_point_of_the_box(rng: np.random.Generator) -> None:
    low, high = np.array([-0.05, -0.02, -0.45]), np.array([0.03, 0.04, -0.4])
    tx_m, rx_m = some_antennas(rng, True)
    near, far = range_limits(low, high, tx_m, rx_m)
    points = rng.uniform(low, high, (1000, 3))
    ranges = sum(np.linalg.norm(side[:, None] - points, axis=2) for side in (tx_m, rx_m)) / 2
    assert (near[:, None] <= ranges).all()
    assert (ranges <= far[:, None]).all()
    inside = range_limits(low, high, 0.5 * (low + high)[None], None)
    assert inside[0] == 0
