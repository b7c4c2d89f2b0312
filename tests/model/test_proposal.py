"""From a raw signal to surfaces: a ball under a small aperture, and what cannot be reconstructed."""

from __future__ import annotations

import dataclasses
import functools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from waveformer.model import proposal as proposal_module
from waveformer.model.imaging_volume import Volume, imaging_volume
from waveformer.model.proposal import Proposal, ProposalSettings, choose_surfaces, propose_surfaces
from waveformer.model.selection import SelectionSettings, select_levels
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
    assert 0.2 < found.column_ratio() < 0.6
    assert not found.uncertain


def test_every_level_has_a_candidate(found: Proposal) -> None:
    steps = np.diff(found.levels_m[0])
    assert np.allclose(steps, 299792458.0 / 77.5001e9 / 2)
    counts = np.bincount(found.stacks[0].level, minlength=len(found.levels_m[0]))
    assert (counts > 0).mean() > 0.9


def test_the_seed_is_all_that_is_random(scan: Measurement, found: Proposal) -> None:
    again = propose_surfaces(scan, COARSE, crop=CROP, rng=np.random.default_rng(0))
    assert np.array_equal(again.surface_m(), found.surface_m())


def test_choosing_again_changes_the_choice_alone(scan: Measurement, found: Proposal) -> None:
    settings = COARSE.model_copy(update={"selection": SelectionSettings(num_antennas=30, loss="magnitude")})
    again = choose_surfaces(found, scan, settings, rng=np.random.default_rng(5))
    assert again.stacks is found.stacks and again.focus is found.focus
    counts = [len(at) for at in found.levels_m]
    expected = select_levels(found.stacks, counts, scan, settings.selection, rng=np.random.default_rng(5))
    assert again.selection is not None
    assert np.array_equal(again.selection.losses[0], expected.losses[0])
    assert again.warnings == found.warnings and again.reason == ""


def test_notes_of_an_earlier_choice_go_with_it(scan: Measurement, found: Proposal) -> None:
    blind = dataclasses.replace(scan, h=0 * scan.h)
    nothing = choose_surfaces(found, blind, COARSE, rng=np.random.default_rng(0))
    assert nothing.reason == "the signal is zero in the range of the candidates"
    assert nothing.warnings == found.warnings and nothing.chosen_m == (None,) * len(found.fields)
    edge = dataclasses.replace(scan, range_bias_m=-0.5)  # an echo at the end of the window
    noted = choose_surfaces(nothing, edge, COARSE, rng=np.random.default_rng(0))
    assert [warning.startswith("no antenna has a clear echo") for warning in noted.warnings].count(True) == 1
    back = choose_surfaces(noted, scan, COARSE, rng=np.random.default_rng(0))
    assert back.warnings == found.warnings and back.reason == ""


def test_blocks_do_not_show(scan: Measurement, found: Proposal, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks place their nodes for their own distance: the image differs by less than 1 %, surfaces by 0.1 mm."""
    small = functools.partial(proposal_module.focus, cells_per_edge=2)
    monkeypatch.setattr(proposal_module, "focus", small)
    other = propose_surfaces(scan, COARSE, crop=CROP, rng=np.random.default_rng(0))
    assert [len(at) for at in other.levels_m] == [len(at) for at in found.levels_m]
    distance_m, _ = KDTree(other.surface_m()).query(found.surface_m())
    assert np.median(distance_m) < 1e-4
    assert np.percentile(distance_m, 99) < 1e-3


def test_threads_do_not_show(tmp_path: Path) -> None:
    program = """
import sys, numpy as np
from waveformer.model import proposal as proposal_module
from waveformer.model.imaging_volume import Volume
from waveformer.model.proposal import propose_surfaces
from waveformer.simulator import Aperture, Chirp, simulate_points
scan = simulate_points([[0.0, 0.0, -0.35], [0.01, 0.0, -0.352]], [1e-3, 1e-3], Chirp(77.5e9, 3e9, 16), Aperture.planar_grid(24, 24, 0.004))
crop = Volume(np.array([-0.03, -0.03, -0.4]), np.array([0.03, 0.03, -0.31]))
found = propose_surfaces(scan, crop=crop, rng=np.random.default_rng(0))
np.savez(sys.argv[1], surface=found.surface_m(), points=found.stacks[0].points_m, loss=found.selection.losses[0])
"""
    results = []
    for threads in ("1", "2"):
        path = tmp_path / f"{threads}.npz"
        command = [sys.executable, "-c", program, str(path)]
        subprocess.run(command, check=True, env={**os.environ, "WAVEFORMER_THREADS": threads})
        results.append(np.load(path))
    # every sum is made by one lane in one order
    for name in ("surface", "points", "loss"):
        assert len(results[0][name])
        assert np.array_equal(results[0][name], results[1][name])


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
    assert nothing.uncertain
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
