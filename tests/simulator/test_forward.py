"""The forward model as a whole: conventions, invariances, repeatability, and what it refuses."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from waveformer.simulator import Aperture, Chirp, Target, primitives, simulate
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.numerics import FAST
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 4e9, 32)
GRID = Aperture.planar_grid(10, 8, 0.006)
PAIRS = Aperture(GRID.tx_m, GRID.tx_m + [0.02, -0.005, 0.0])
IRREGULAR = Aperture(
    GRID.tx_m, GRID.tx_m + np.random.default_rng(5).uniform(-0.02, 0.02, GRID.tx_m.shape) * [1, 1, 0]
)
SINGLE = Aperture.from_preset("single")
MODES = pytest.mark.parametrize("mode", ["fast", "exact"])
APERTURES = pytest.mark.parametrize(
    "aperture", [GRID, PAIRS, IRREGULAR], ids=["monostatic", "pairs", "irregular"]
)


def moved(mesh: Any, x_m: float, y_m: float, z_m: float) -> Any:
    mesh = mesh.copy()
    mesh.apply_translation([x_m, y_m, z_m])
    return mesh


BALL = primitives.sphere(0.02, 0.004)
PLATE = primitives.plate(0.04, 0.03)
SCENE = moved(BALL, 0.01, 0, -0.3) + moved(primitives.box(0.02, 0.02, 0.01), -0.005, 0.005, -0.25)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max() / np.abs(other).max())


@MODES
def test_the_measurement_has_one_row_a_pair_and_carries_the_radar(mode: str) -> None:
    measurement = simulate(moved(PLATE, 0, 0, -0.3), CHIRP, SINGLE, mode=mode, seed=7)
    assert measurement.h.shape == (1, CHIRP.num_samples)
    assert measurement.h.dtype == np.complex64
    assert measurement.chirp == CHIRP
    assert measurement.aperture is SINGLE
    assert measurement.range_bias_m == 0
    assert measurement.metadata["seed"] == 7
    assert measurement.metadata["numerics"]["direct"] is (mode == "exact")
    assert measurement.metadata["targets"][0]["bounds_m"][1][2] == pytest.approx(-0.3)


@MODES
def test_a_large_mirror_returns_minus_lambda_over_8_pi_d_with_the_phase_of_the_way_to_it_and_back(
    mode: str,
) -> None:
    distance_m, side_m = 0.3, 0.36
    h = simulate(primitives.plate(side_m, side_m, center_m=(0, 0, -distance_m)), CHIRP, SINGLE, mode=mode).h[
        0
    ]
    k = 2 * np.pi / CHIRP.wavelengths_m
    mirror = -CHIRP.wavelengths_m / (8 * np.pi * distance_m) * np.exp(-2j * k * distance_m)
    # Fresnel: both ends of both axes echo with sqrt(d / (pi k)) / side a piece, relative to the mirror
    edges = 4 * np.sqrt(distance_m / (np.pi * k)) / side_m
    assert (np.abs(h / mirror - 1) < edges).all()
    assert edges.max() < 0.1
    # what the edges add turns over the band, so that the mean comes closer
    assert (h / mirror).mean() == pytest.approx(1.0, abs=0.02)


@MODES
def test_moving_a_target_away_by_an_eighth_of_a_wavelength_turns_the_phase_by_minus_90_degrees(
    mode: str,
) -> None:
    sample = 16
    step_m = CHIRP.wavelengths_m[sample] / 8
    near, far = (
        simulate(Target(BALL, pose=trimesh.transformations.translation_matrix([0, 0, -0.6 - s])), CHIRP, SINGLE,
                 mode=mode).h[0, sample]
        for s in (0.0, step_m)
    )  # fmt: skip
    # the facets of the ball are seen from a distance larger by 0.1 %: 2 % and 1 degree are ample
    assert np.degrees(np.angle(far / near)) == pytest.approx(-90, abs=1)
    assert abs(far / near) == pytest.approx(1, abs=0.02)


def test_the_range_profile_of_a_ball_peaks_at_its_nearest_point() -> None:
    measurement = simulate(moved(BALL, 0, 0, -0.4), CHIRP, SINGLE)
    range_m, profile = measurement.range_profile(oversampling=16)
    assert range_m[profile[0].argmax()] == pytest.approx(0.38, abs=0.25 * CHIRP.range_bin_m)  # facets


def test_targets_that_do_not_shadow_each_other_superpose() -> None:
    left, right = moved(BALL, -0.1, 0, -0.3), moved(PLATE, 0.1, 0.02, -0.35)
    together = simulate([left, right], CHIRP, GRID).h
    apart = simulate(left, CHIRP, GRID).h + simulate(right, CHIRP, GRID).h
    assert difference(together, apart) < 1e-5  # float32


@MODES
def test_a_target_in_the_shadow_of_another_does_not_echo(mode: str) -> None:
    screen, hidden = moved(primitives.plate(0.2, 0.2), 0, 0, -0.25), moved(BALL, 0, 0, -0.35)
    both = simulate([screen, hidden], CHIRP, GRID, mode=mode).h
    assert (
        difference(both, simulate(screen, CHIRP, GRID, mode=mode).h) < 1e-6
    )  # float32 sums in another order


def test_a_pose_moves_the_target_as_moving_its_vertices_would() -> None:
    pose = trimesh.transformations.euler_matrix(0.3, -0.5, 1.1)
    pose[:3, 3] = [0.01, -0.02, -0.3]
    mesh = primitives.box(0.03, 0.02, 0.01, 0.01)
    posed = simulate(Target(mesh, pose=pose), CHIRP, GRID).h
    mesh.apply_transform(pose)
    # rounding of the vertices may bisect triangles with two equal edges elsewhere: quadrature error
    assert difference(posed, simulate(mesh, CHIRP, GRID).h) < 1e-3


@MODES
@pytest.mark.parametrize("aperture", [PAIRS, IRREGULAR], ids=["pairs", "irregular"])
def test_transmitters_and_receivers_may_change_places(mode: str, aperture: Aperture) -> None:
    swapped = Aperture(aperture.receivers_m, aperture.tx_m)
    h = simulate(SCENE, CHIRP, aperture, mode=mode).h
    assert difference(simulate(SCENE, CHIRP, swapped, mode=mode).h, h) < 1e-5  # float32


def test_a_receiver_at_its_transmitter_is_monostatic() -> None:
    h = simulate(SCENE, CHIRP, Aperture(GRID.tx_m, GRID.tx_m)).h
    assert difference(h, simulate(SCENE, CHIRP, GRID).h) < 1e-5  # float32


@APERTURES
@pytest.mark.parametrize(("mode", "tile_positions"), [("fast", 7), ("fast", 50), ("exact", 7), ("exact", 50)])
def test_tile_positions_changes_rounding_only(mode: str, tile_positions: int, aperture: Aperture) -> None:
    whole = simulate(SCENE, CHIRP, aperture, mode=mode).h
    parts = simulate(SCENE, CHIRP, aperture, mode=mode, tile_positions=tile_positions).h
    assert difference(parts, whole) < 1e-5  # float32


@APERTURES
def test_the_fast_mode_agrees_with_the_exact_one(aperture: Aperture) -> None:
    fast, exact = (simulate(SCENE, CHIRP, aperture, mode=mode).h for mode in ("fast", "exact"))
    # quadrature at lambda/3 instead of lambda/4 and shadows interpolated between rays: about 1 % each
    assert difference(fast, exact) < 0.03


@APERTURES
def test_the_draft_mode_stays_near_the_fast_one(aperture: Aperture) -> None:
    mug = moved(primitives.mug(0.004), 0, 0, -0.35)
    draft, fast = (simulate(mug, CHIRP, aperture, mode=mode).h for mode in ("draft", "fast"))
    # interpolations are bounded by 4 %, edges of shadows are a small part of the echo
    assert 1e-6 < difference(draft, fast) < 0.03


def test_a_numerics_may_stand_for_a_mode() -> None:
    assert (simulate(SCENE, CHIRP, GRID, mode=FAST).h == simulate(SCENE, CHIRP, GRID, mode="fast").h).all()


@MODES
def test_what_no_antenna_sees_echoes_nothing(mode: str) -> None:
    hidden = moved(BALL, 0, 0, -0.35)
    shell = moved(primitives.box(0.1, 0.1, 0.1), 0, 0, -0.35)
    both = simulate([hidden, shell], CHIRP, SINGLE, mode=mode).h
    alone = simulate(shell, CHIRP, SINGLE, mode=mode).h
    assert (both == alone).all()


@MODES
def test_a_scene_out_of_sight_gives_zeros(mode: str) -> None:
    """A plate on edge: antenna and plate in one plane, no side lit."""
    upright = primitives.plate(0.04, 0.04)
    upright.apply_transform([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, -0.3], [0, 0, 0, 1]])
    h = simulate(upright, CHIRP, SINGLE, mode=mode).h
    mirror = CHIRP.wavelengths_m[0] / (8 * np.pi * 0.3)
    assert np.abs(h).max() < 1e-6 * mirror  # cosines of float32


@MODES
def test_progress_rises_to_the_number_of_positions(mode: str) -> None:
    calls: list[tuple[int, int]] = []
    targets = [moved(BALL, -0.1, 0, -0.3), moved(BALL, 0.1, 0, -0.3)]
    simulate(targets, CHIRP, GRID, mode=mode, tile_positions=30, progress=lambda *call: calls.append(call))
    assert calls[-1] == (len(GRID), len(GRID))
    assert len(calls) >= 4
    assert [done for done, _ in calls] == sorted(done for done, _ in calls)


@MODES
def test_progress_ends_at_the_number_of_positions_though_the_last_target_is_hidden(mode: str) -> None:
    calls: list[tuple[int, int]] = []
    targets = [moved(primitives.plate(0.2, 0.2), 0, 0, -0.25), moved(BALL, 0, 0, -0.35)]
    simulate(targets, CHIRP, GRID, mode=mode, progress=lambda *call: calls.append(call))
    assert calls[-1] == (len(GRID), len(GRID))


@pytest.mark.parametrize(
    ("target", "says"),
    [
        (moved(PLATE, 0, 0, 0.3), "lies behind the aperture"),
        (moved(BALL, 0, 0, 0.0), "reaches through the aperture"),
        (moved(BALL, 0, 0, -0.02), "touches or reaches"),
        (moved(PLATE, 0, 0, -0.01), "10.0 mm from an antenna .* keep at least 19 mm"),
    ],
)
def test_a_mesh_at_the_aperture_is_refused(target: Any, says: str) -> None:
    with pytest.raises(MeshError, match=says) as caught:
        simulate(target, CHIRP, GRID)
    assert caught.value.code == "mesh.at_aperture"
    assert "\n" not in str(caught.value)


def test_a_mesh_just_outside_five_wavelengths_is_accepted() -> None:
    nearest_m = 5 * float(CHIRP.wavelengths_m[0])
    assert simulate(moved(PLATE, 0, 0, -1.001 * nearest_m), CHIRP, SINGLE).h.any()
    with pytest.raises(MeshError):
        simulate(moved(PLATE, 0, 0, -0.999 * nearest_m), CHIRP, SINGLE)


def test_a_mesh_beyond_the_unambiguous_range_is_refused_with_both_ranges() -> None:
    assert CHIRP.unambiguous_range_m == pytest.approx(1.2, abs=1e-3)
    with pytest.raises(
        RadarError, match=r"reaches 1\.50 m .* unambiguous range 1\.20 m of 32 samples over 4 GHz"
    ):
        simulate(moved(PLATE, 0, 0, -1.5), CHIRP, SINGLE)
    assert simulate(moved(PLATE, 0, 0, -1.19), CHIRP, SINGLE).h.any()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"mode": "quick"}, "unknown mode 'quick'; known: fast, exact"),
        ({"mode": None}, "unknown mode None; known: fast, exact"),
        ({"tile_positions": 0}, "tile_positions must be a whole number of at least 1, got 0"),
        ({"tile_positions": -3}, "tile_positions must be a whole number of at least 1, got -3"),
    ],
)
def test_senseless_options_are_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(RadarError, match=says):
        simulate(moved(PLATE, 0, 0, -0.3), CHIRP, SINGLE, **options)


def test_no_target_is_refused() -> None:
    with pytest.raises(MeshError, match="at least one mesh"):
        simulate([], CHIRP, SINGLE)


def test_one_bad_target_of_several_is_named(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"gone\.stl"):
        simulate([moved(PLATE, 0, 0, -0.3), tmp_path / "gone.stl"], CHIRP, SINGLE)


SIMULATE_IN_A_CHILD = """
import sys
import numpy as np
from waveformer.simulator import Aperture, Chirp, primitives, simulate
mesh = primitives.mug(0.012)
mesh.apply_translation([0.0, 0.0, -0.4])
for mode in ("fast", "exact"):
    h = simulate(mesh, Chirp(77e9, 4e9, 32), Aperture.planar_grid(8, 6, 0.01), mode=mode).h
    np.save(f"{sys.argv[1]}_{mode}.npy", h)
"""


def in_a_child(folder: Path, name: str, threads: int) -> dict[str, np.ndarray]:
    subprocess.run(
        [sys.executable, "-c", SIMULATE_IN_A_CHILD, str(folder / name)],
        env={**os.environ, "WAVEFORMER_THREADS": str(threads)},
        check=True,
        timeout=120,
    )
    return {mode: np.load(folder / f"{name}_{mode}.npy") for mode in ("fast", "exact")}


def test_one_thread_repeats_its_bytes_in_another_process_and_two_threads_differ_by_rounding(
    tmp_path: Path,
) -> None:
    first, second, two = (in_a_child(tmp_path, name, n) for name, n in (("a", 1), ("b", 1), ("c", 2)))
    for mode in ("fast", "exact"):
        assert first[mode].tobytes() == second[mode].tobytes()
        assert difference(two[mode], first[mode]) < 1e-5  # float32: threads add in another order


def test_a_call_repeats_its_bytes_in_the_same_process() -> None:
    one, other = (simulate(SCENE, CHIRP, GRID).h for _ in range(2))
    assert one.tobytes() == other.tobytes()


def test_the_frequency_slope_of_the_phase_is_the_delay() -> None:
    h = simulate(moved(primitives.disc(0.004), 0, 0, -0.5), CHIRP, SINGLE).h[0]
    slope = np.diff(np.unwrap(np.angle(h))) / np.diff(CHIRP.frequencies_hz)
    delay_s = 2 * 0.5 / SPEED_OF_LIGHT_M_PER_S
    assert slope == pytest.approx(np.full(31, -2 * np.pi * delay_s), rel=1e-3)  # 0.02 mm of curvature
