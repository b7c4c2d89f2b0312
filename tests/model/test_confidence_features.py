"""Each feature moves the right way when what it stands for gets worse."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest

from waveformer.model.confidence_features import (
    ConfidenceFeatures,
    confidence_features,
    image_floor_db,
    normal_roughness,
)
from waveformer.model.selection import Selection, SelectionSettings, select_levels
from waveformer.model.surfaces import SurfaceStack
from waveformer.simulator.errors import RadarError
from waveformer.simulator.forward import simulate
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.primitives import sphere
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77.5001e9, 3.0009e9, 64)
RADIUS_M = 0.03
CENTER_M = np.array([0.0, 0.0, -0.43])
NUM_LEVELS = 15
GRID = Grid.box((-0.03, -0.03, -0.44), (0.03, 0.03, -0.38), 0.003)
SETTINGS = SelectionSettings(num_antennas=100)


def caps(shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> SurfaceStack:
    parts = []
    for level in range(NUM_LEVELS):
        radius_m = RADIUS_M + (level - 7) * 1.93e-3
        axis = np.arange(-radius_m, radius_m, 1e-3)
        x, y = (values.ravel() for values in np.meshgrid(axis, axis))
        inside = np.hypot(x, y) < 0.8 * radius_m
        z = np.sqrt(radius_m**2 - x[inside] ** 2 - y[inside] ** 2)
        normals = np.stack([x[inside], y[inside], z], axis=1) / radius_m
        points = CENTER_M + shift_m + radius_m * normals
        parts.append((points, normals, 1e-6 / normals[:, 2], np.full(len(z), level)))
    return SurfaceStack(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def image_of(rng: np.random.Generator, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A bright ball, radial normals, and noise in both."""
    x, y, z = np.meshgrid(GRID.x, GRID.y, GRID.z, indexing="ij")
    offset = np.stack([x, y, z], axis=-1) - CENTER_M
    distance = np.linalg.norm(offset, axis=-1)
    image = np.exp(-((distance - RADIUS_M) ** 2) / 2e-5) + noise * rng.normal(size=x.shape) + 0j
    normals = offset / distance[..., None] + noise * rng.normal(size=(*x.shape, 3))
    normals /= np.linalg.norm(normals, axis=-1)[..., None]
    return image, normals, np.abs(distance - RADIUS_M) < 0.006


def features_of(
    scan: Measurement,
    rng: np.random.Generator,
    noise: float = 0.01,
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> ConfidenceFeatures:
    image, normals, mask = image_of(rng, noise)
    stacks = [caps(shift_m)]
    selection = select_levels(stacks, [NUM_LEVELS], scan, SETTINGS, rng=np.random.default_rng(0))
    features = confidence_features(selection, stacks, scan, GRID, image, normals, mask, 0.5)
    assert features is not None
    assert np.isfinite(features).all()
    return features


@pytest.fixture(scope="module")
def scan(mitsuba_variant: str) -> Measurement:
    aperture = Aperture.planar_grid(16, 21, 0.02)
    return simulate(sphere(RADIUS_M).apply_translation(CENTER_M), CHIRP, aperture)


@functools.cache
def row_phases() -> np.ndarray:
    """Depth errors of 0.3 mm rms, one for each of 21 rows."""
    error_m = np.random.default_rng(3).normal(0.0, 3e-4, 21)
    phase = -4j * np.pi * CHIRP.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    return np.repeat(np.exp(error_m[:, None] * phase), 16, axis=0)


def test_a_clean_scan(scan: Measurement, rng: np.random.Generator) -> None:
    features = features_of(scan, rng)
    assert features.misfit < np.log1p(1e3 * 0.005) / np.log1p(1e3)  # half a per cent of the power unexplained
    assert features.contrast > 0.75
    assert features.level_spread < np.log(2)
    assert features.neighbour_agreement > 0.95
    assert features.block_agreement > 0.9
    assert features.depth_agreement > 0.95
    assert features.column_ratio == 0.5


def test_extent_is_the_diagonal_of_the_chosen_surface(scan: Measurement, rng: np.random.Generator) -> None:
    features = features_of(scan, rng)
    stack = caps((0.0, 0.0, 0.0))
    diagonals = [np.linalg.norm(np.ptp(stack.points_m[stack.level == i], axis=0)) for i in range(NUM_LEVELS)]
    assert min(diagonals) <= np.exp(features.log_extent) <= max(diagonals)


def test_ambiguity_counts_the_levels_that_fit_nearly_as_well(
    scan: Measurement, rng: np.random.Generator
) -> None:
    clean = features_of(scan, rng)
    depth_m = np.exp(clean.log_ambiguity + clean.log_extent)
    levels = depth_m / (float(CHIRP.wavelengths_m[0]) / 2)
    assert abs(levels - round(levels)) < 1e-6 and 1 <= round(levels) <= 3


def test_ambiguity_by_hand(scan: Measurement) -> None:
    from waveformer.model.confidence_features import _ambiguity_m

    wavelength_m = float(CHIRP.wavelengths_m[0])
    for losses, count in (
        ([0.9, 0.2, 0.8, 0.8, 0.9], 1),
        ([0.9, 0.2, 0.25, 0.8, 0.9], 2),  # 0.2 + 0.1 * (0.8 - 0.2) = 0.26
        ([0.9, 0.2, 0.25, 0.9, 0.27, 0.9], 1),  # the median is lower
        ([0.5, 0.5, 0.5], 3),
    ):
        correlation = of_losses(np.repeat(np.array(losses)[:, None], 8, axis=1))
        selection = Selection(
            (-1, 1), (np.empty((0, 8)),) * 2, np.arange(8), None, "", (np.empty((0, 8)), correlation)
        )
        assert _ambiguity_m(selection, scan) == pytest.approx(count * wavelength_m / 2)


def of_losses(losses: np.ndarray) -> np.ndarray:
    """Correlations with these losses: log(1 + 1000 (1 - |c|^2)) / log(1001)."""
    return np.sqrt(1.0 - (1001.0**losses - 1.0) / 1000.0) + 0j


def test_white_noise(scan: Measurement, rng: np.random.Generator) -> None:
    clean = features_of(scan, rng)
    rms = np.sqrt((np.abs(scan.h) ** 2).mean())
    noise = (rng.normal(size=scan.h.shape) + 1j * rng.normal(size=scan.h.shape)) * 3 * rms
    noisy = features_of(dataclasses.replace(scan, h=scan.h + noise), rng, 0.2)
    assert noisy.misfit > 3 * clean.misfit
    assert noisy.contrast < clean.contrast
    assert noisy.neighbour_agreement < 0.7 * clean.neighbour_agreement
    assert noisy.block_agreement < 0.8 * clean.block_agreement
    assert noisy.image_floor_db > clean.image_floor_db + 6
    assert noisy.normal_roughness > clean.normal_roughness


def test_row_errors_show_in_the_phase_and_hardly_in_the_loss(
    scan: Measurement, rng: np.random.Generator
) -> None:
    clean = features_of(scan, rng)
    shaken = features_of(dataclasses.replace(scan, h=scan.h * row_phases()), rng)
    assert shaken.misfit < 1.5 * clean.misfit
    assert shaken.neighbour_agreement < 0.7 * clean.neighbour_agreement


def test_wrong_depth_makes_the_phase_drift(scan: Measurement, rng: np.random.Generator) -> None:
    clean = features_of(scan, rng)
    deep = features_of(scan, rng, shift_m=(0.0, 0.0, -0.02))  # a larger radius makes up for it overhead only
    assert deep.block_agreement < 0.7 * clean.block_agreement
    assert deep.neighbour_agreement > deep.block_agreement + 0.2  # antennas 2 cm apart hardly see it


def test_phases_that_prefer_another_level_than_the_loss(scan: Measurement, rng: np.random.Generator) -> None:
    centers = scan.aperture.tx_m
    drift = np.exp(2j * np.pi / 0.15 * centers[:, 0])
    rows = np.arange(len(centers))
    losses = np.stack([np.full(len(rows), value) for value in (0.9, 0.1, 0.9)])
    correlations = np.stack([np.ones(len(rows)) + 0j, drift, 0 * drift])
    image, normals, mask = image_of(rng, 0.0)
    agreements = []
    for chosen in (0, 1):
        selection = Selection((chosen,), (losses,), rows, None, "", (correlations,))
        features = confidence_features(selection, [caps()], scan, GRID, image, normals, mask, 0.5)
        assert features is not None
        agreements.append(features.depth_agreement)
    assert agreements[0] == pytest.approx(1.0)
    assert agreements[1] < 0.6
    powers = Selection((1,), (losses,), rows, None)
    assert confidence_features(powers, [caps()], scan, GRID, image, normals, mask, 0.5) is None


def test_groups_that_disagree() -> None:
    losses = np.ones((9, 8))
    losses[4, :6] = losses[0, 6:] = 0.0  # the last quarter of the antennas votes for level 0
    losses[4, 6:] = 0.9
    correlations = (np.empty((0, 8)), of_losses(losses))
    selection = Selection((-1, 4), (np.empty((0, 8)), losses), np.arange(8), None, "", correlations)
    from waveformer.model.confidence_features import _loss_features

    misfit, contrast, spread = _loss_features(selection)
    assert misfit == pytest.approx(0.9 / 4)
    assert contrast == pytest.approx(1 - misfit)
    assert spread == pytest.approx(np.log1p(np.sqrt(4**2 / 4)))


def test_floor_by_hand() -> None:
    image = np.full((2, 3, 4), 0.01 + 0j)
    image[0, 0, 0] = -1j
    mask = image == -1j
    assert image_floor_db(image, mask) == pytest.approx(-40.0)
    assert image_floor_db(image, ~mask) == pytest.approx(0.0)
    assert image_floor_db(0 * image, mask) == 0.0
    assert image_floor_db(image, np.ones_like(mask)) == 0.0
    assert image_floor_db(np.where(mask, image, 0), mask) == -80.0


def test_roughness_of_a_sphere_is_its_curvature(rng: np.random.Generator) -> None:
    x, y, z = np.meshgrid(GRID.x, GRID.y, GRID.z, indexing="ij")
    offset = np.stack([x, y, z], axis=-1) - (0.0, 0.0, -0.6)
    radius_m = np.linalg.norm(offset, axis=-1, keepdims=True)
    mask = np.ones(GRID.shape, dtype=bool)
    normals = offset / radius_m
    # A step across the radius turns the normal by 1 / r, a step along it not at all.
    expected = np.degrees(1e-3 * np.sqrt(1 - normals**2) / radius_m).mean()
    assert normal_roughness(normals, mask, GRID) == pytest.approx(expected, rel=0.01)
    assert normal_roughness(np.full((*GRID.shape, 3), np.nan), mask, GRID) == 0.0


def test_no_choice_no_features(scan: Measurement, rng: np.random.Generator) -> None:
    image, normals, mask = image_of(rng, 0.0)
    empty = Selection((-1,), (np.empty((0, 0)),), np.empty(0, dtype=np.int64), None, "no candidate")
    assert confidence_features(empty, [caps()], scan, GRID, image, normals, mask, 0.5) is None
    with pytest.raises(RadarError, match="must fit the grid"):
        confidence_features(empty, [caps()], scan, GRID, image[1:], normals, mask, 0.5)
