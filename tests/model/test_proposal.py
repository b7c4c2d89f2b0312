"""From a raw signal to surfaces: a ball under a small aperture, and what cannot be reconstructed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from waveformer.model.imaging_volume import Volume, imaging_volume
from waveformer.model.proposal import Proposal, ProposalSettings, propose_surfaces
from waveformer.simulator import Aperture, Chirp, Measurement, RadarError, primitives, simulate

RADIUS_M, TOP_M = 0.04, -0.36
CENTER_M = np.array([0.01, -0.01, TOP_M - RADIUS_M])
CROP = Volume(CENTER_M - [0.05, 0.05, 0.045], CENTER_M + [0.05, 0.05, 0.085])
COARSE = ProposalSettings(spacing_m=0.004)


@pytest.fixture(scope="module")
def scan() -> Measurement:
    ball = primitives.sphere(RADIUS_M)
    ball.apply_translation(CENTER_M)
    return simulate(ball, Chirp(77.5001e9, 3.0009e9, 32), Aperture.planar_grid(40, 40, 0.004))


@pytest.fixture(scope="module")
def found(scan: Measurement) -> Proposal:
    return propose_surfaces(scan, COARSE, crop=CROP, rng=np.random.default_rng(0))


def off_the_ball_m(points_m: np.ndarray) -> np.ndarray:
    return np.abs(np.linalg.norm(points_m - CENTER_M, axis=1) - RADIUS_M)


def test_the_chosen_surface_lies_on_the_ball(mitsuba_variant: None, found: Proposal) -> None:
    assert found.reason == ""
    assert len(found.fields) == len(found.levels_m) == len(found.stacks) == len(found.chosen_m)
    surface = found.surface_m()
    assert len(surface) > 100
    # a level is 1.9 mm from the next, and the choice may be one off
    assert np.median(off_the_ball_m(surface)) < 2e-3
    # a layer of two voxels of 4 mm
    assert np.median(off_the_ball_m(found.voxels_m())) < 4e-3
    assert 0.2 < found.column_ratio() < 0.8


def test_every_level_has_a_candidate(found: Proposal) -> None:
    steps = np.diff(found.levels_m[0])
    assert np.allclose(steps, 299792458.0 / 77.5001e9 / 2)
    counts = np.bincount(found.stacks[0].level, minlength=len(found.levels_m[0]))
    assert (counts > 0).mean() > 0.9


def test_the_seed_is_all_that_is_random(scan: Measurement, found: Proposal) -> None:
    again = propose_surfaces(scan, COARSE, crop=CROP, rng=np.random.default_rng(0))
    assert np.array_equal(again.surface_m(), found.surface_m())


def test_confidence_has_its_features(scan: Measurement, found: Proposal) -> None:
    features = found.features(scan)
    assert features is not None
    assert np.isfinite(features).all()


def test_the_object_is_found_without_a_crop(scan: Measurement) -> None:
    whole = propose_surfaces(scan, COARSE, rng=np.random.default_rng(0))
    assert np.median(off_the_ball_m(whole.surface_m())) < 3e-3


def test_the_least_squares_field_agrees(scan: Measurement, found: Proposal) -> None:
    settings = COARSE.model_copy(update={"field": "least_squares"})
    smooth = propose_surfaces(scan, settings, crop=CROP, rng=np.random.default_rng(0))
    assert np.median(off_the_ball_m(smooth.surface_m())) < 3e-3


def test_silence_has_a_reason(scan: Measurement) -> None:
    silent = dataclasses.replace(scan, h=np.zeros_like(scan.h))
    nothing = propose_surfaces(silent, COARSE, crop=CROP, rng=np.random.default_rng(0))
    assert "zero" in nothing.reason
    assert nothing.surface_m().shape == nothing.voxels_m().shape == (0, 3)
    assert nothing.features(silent) is None
    assert np.isnan(nothing.column_ratio())


def test_noise_alone_does_not_crash(scan: Measurement, rng: np.random.Generator) -> None:
    noise = dataclasses.replace(scan, h=rng.standard_normal((*scan.h.shape, 2)) @ [1.0, 1.0j])
    result = propose_surfaces(noise, COARSE, crop=CROP, rng=np.random.default_rng(0))
    assert result.reason or len(result.surface_m())


def test_a_crop_beside_the_object_gives_a_reason_or_a_weak_part(scan: Measurement) -> None:
    beside = Volume(CROP.min_m + [0.12, 0.1, 0.0], CROP.max_m + [0.12, 0.1, 0.0])
    result = propose_surfaces(scan, COARSE, crop=beside, rng=np.random.default_rng(0))
    assert result.reason


def test_bad_input_is_refused(scan: Measurement) -> None:
    h = scan.h.copy()
    h[0, 0] = np.inf
    with pytest.raises(RadarError, match="non-finite"):
        propose_surfaces(dataclasses.replace(scan, h=h), crop=CROP, rng=np.random.default_rng(0))
    far = Volume(np.array([5.0, 5.0, 5.0]), np.array([6.0, 6.0, 6.0]))
    with pytest.raises(RadarError, match="misses the imaged volume"):
        propose_surfaces(scan, crop=far, rng=np.random.default_rng(0))


def test_the_volume_is_mitos(scan: Measurement) -> None:
    volume = imaging_volume(scan)
    assert volume.min_m[2] == pytest.approx(-0.5)
    assert volume.max_m[2] == pytest.approx(-0.25)
    assert volume.max_m[0] - volume.min_m[0] == pytest.approx(0.156 + 0.25)
