"""Choice of a level: the sphere that echoed among concentric ones, two patches, biases, and bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pydantic import ValidationError

from waveformer.model.level_choice import residual_losses
from waveformer.model.selection import Selection, SelectionSettings, select_levels
from waveformer.model.surfaces import SurfaceStack
from waveformer.simulator.arrays import with_receivers
from waveformer.simulator.errors import RadarError
from waveformer.simulator.forward import simulate
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.primitives import sphere
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77.5001e9, 3.0009e9, 64)
STEP_M = SPEED_OF_LIGHT_M_PER_S / 77.5001e9 / 2
RADIUS_M = 0.03
CENTER_M = np.array([0.01, -0.02, -0.43])
NUM_LEVELS, TRUE_LEVEL = 25, 11
SETTINGS = SelectionSettings(num_antennas=50)


def caps(center_m: np.ndarray = CENTER_M, spacing_m: float = 1e-3) -> SurfaceStack:
    """Tops of concentric spheres as height fields; the one at TRUE_LEVEL has the true radius."""
    parts = []
    for level in range(NUM_LEVELS):
        radius_m = RADIUS_M + (level - TRUE_LEVEL) * STEP_M
        axis = np.arange(-radius_m, radius_m, spacing_m)
        x, y = (values.ravel() for values in np.meshgrid(axis, axis))
        inside = np.hypot(x, y) < 0.8 * radius_m
        z = np.sqrt(radius_m**2 - x[inside] ** 2 - y[inside] ** 2)
        normals = np.stack([x[inside], y[inside], z], axis=1) / radius_m
        level_of = np.full(len(z), level)
        parts.append((center_m + radius_m * normals, normals, spacing_m**2 / normals[:, 2], level_of))
    return SurfaceStack(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def echo_of_spheres(centers_m: list[np.ndarray], aperture: Aperture, bias_m: float = 0.0) -> Measurement:
    meshes = [sphere(RADIUS_M).apply_translation(center_m) for center_m in centers_m]
    return simulate(meshes, CHIRP, aperture, front_end=FrontEnd(range_bias_m=bias_m))


def choose(scan: Measurement, settings: SelectionSettings = SETTINGS, seed: int = 0) -> Selection:
    return select_levels([caps()], [NUM_LEVELS], scan, settings, rng=np.random.default_rng(seed))


@pytest.fixture(scope="module")
def scan(mitsuba_variant: str) -> Measurement:
    return echo_of_spheres([CENTER_M], Aperture.planar_grid(16, 21, 0.02))


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("window", ["object", "mmnorm"])
def test_the_sphere_that_echoed_is_found(scan: Measurement, window: str, seed: int) -> None:
    selection = choose(scan, SETTINGS.model_copy(update={"window": window}), seed)
    assert abs(selection.level_index[0] - TRUE_LEVEL) <= 1  # a level is half a wavelength
    assert not selection.is_empty
    assert selection.note == ""
    assert len(selection.rows) == 50
    assert selection.antenna_losses[0].shape == (NUM_LEVELS, 50)
    assert selection.losses[0].argmin() == selection.level_index[0]
    # the losses are those of the complex profile, not of its magnitudes
    np.testing.assert_array_equal(selection.antenna_losses[0], residual_losses(selection.correlations[0]))
    # the true surface explains the phases, too, but for one common turn
    correlation = selection.correlations[0][TRUE_LEVEL]
    assert np.abs(correlation.mean()) > 0.95
    # a sharp minimum: the levels 10 mm away fit several times worse
    losses = selection.losses[0]
    assert min(losses[TRUE_LEVEL - 5], losses[TRUE_LEVEL + 5]) > 3 * losses.min()


def test_powers_find_it_too(scan: Measurement) -> None:
    selection = choose(scan, SelectionSettings(num_antennas=50, coherent=False, loss="magnitude"))
    # Whole caps reach deeper than the glint: powers favour a higher surface, by 6 mm here.
    assert 1 <= selection.level_index[0] - TRUE_LEVEL <= 5
    assert selection.correlations == ()


def test_last_peak_agrees_where_there_is_one_minimum(scan: Measurement) -> None:
    by_magnitude = SelectionSettings(num_antennas=50, loss="magnitude")
    selection = choose(scan, by_magnitude.model_copy(update={"choice": "last_peak"}))
    assert selection.level_index == choose(scan, by_magnitude).level_index


def test_magnitudes_find_it_too(scan: Measurement) -> None:
    selection = choose(scan, SelectionSettings(num_antennas=50, loss="magnitude"))
    assert abs(selection.level_index[0] - TRUE_LEVEL) <= 1
    losses = selection.losses[0]
    assert min(losses[TRUE_LEVEL - 5], losses[TRUE_LEVEL + 5]) > 3 * losses.min()


def test_noise_misleads_magnitudes_more_than_phases(scan: Measurement) -> None:
    """Twenty draws of noise of twice the power of the echo (each part 1.5 of its rms): the phase across bins is what is left of the depth."""
    rng = np.random.default_rng(1)
    sigma = 1.5 * np.sqrt((np.abs(scan.h) ** 2).mean())
    errors: dict[str, list[int]] = {"complex": [], "magnitude": []}
    for seed in range(20):
        noise = sigma * (rng.normal(size=scan.h.shape) + 1j * rng.normal(size=scan.h.shape))
        noisy = dataclasses.replace(scan, h=scan.h + noise)
        for loss, found in errors.items():
            choice = choose(noisy, SelectionSettings(num_antennas=20, loss=loss), seed)
            found.append(abs(choice.level_index[0] - TRUE_LEVEL))
    assert np.mean(errors["complex"]) < 0.7 * np.mean(errors["magnitude"])


def test_at_another_depth_than_mmnorms_window() -> None:
    deep_m = CENTER_M + [0, 0, -0.6]
    scan = echo_of_spheres([deep_m], Aperture.planar_grid(10, 10, 0.03))
    selection = select_levels([caps(deep_m)], [NUM_LEVELS], scan, SETTINGS, rng=np.random.default_rng(0))
    assert abs(selection.level_index[0] - TRUE_LEVEL) <= 1


def test_pairs_and_range_bias_are_respected() -> None:
    aperture = with_receivers(Aperture.planar_grid(8, 10, 0.04), "mito")
    selection = choose(echo_of_spheres([CENTER_M], aperture, bias_m=0.15))
    assert abs(selection.level_index[0] - TRUE_LEVEL) <= 1


@pytest.mark.parametrize("bias_m", [0.02, -0.02])
def test_an_unknown_bias_moves_the_choice_by_half_of_it(scan: Measurement, bias_m: float) -> None:
    moved = choose(dataclasses.replace(scan, range_bias_m=bias_m))
    # the path that remains is 20 mm shorter (longer), the surface 10 mm nearer (farther): 5.2 levels
    assert abs(moved.level_index[0] - TRUE_LEVEL - bias_m / 2 / STEP_M) <= 1.2


def test_two_components_whose_echoes_add() -> None:
    centers = [np.array([-0.06, 0.0, -0.43]), np.array([0.07, 0.02, -0.41])]
    scan = echo_of_spheres(centers, Aperture.planar_grid(16, 21, 0.02))
    stacks = [caps(center) for center in centers]
    selection = select_levels(stacks, [NUM_LEVELS] * 2, scan, rng=np.random.default_rng(0))
    assert np.abs(np.array(selection.level_index) - TRUE_LEVEL).max() <= 1
    last = select_levels(
        stacks,
        [NUM_LEVELS] * 2,
        scan,
        SelectionSettings(choice="last_peak", loss="magnitude"),
        rng=np.random.default_rng(0),
    )
    assert np.abs(np.array(last.level_index) - TRUE_LEVEL).max() <= 1
    alone = select_levels(stacks[:1], [NUM_LEVELS], scan, rng=np.random.default_rng(0))
    assert selection.losses[0].min() < 0.5 * alone.losses[0].min()  # one sphere leaves the other unexplained


def test_a_repetition_gives_the_same_numbers(scan: Measurement) -> None:
    first, second = choose(scan), choose(scan)
    assert (first.rows == second.rows).all()
    assert (first.antenna_losses[0] == second.antenna_losses[0]).all()


NOTHING = SurfaceStack(np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0, dtype=np.int64))


def test_nothing_to_choose_from(scan: Measurement) -> None:
    for stacks, counts in (([], []), ([NOTHING], [0]), ([NOTHING, NOTHING], [0, 7])):
        selection = select_levels(stacks, counts, scan, SETTINGS, rng=np.random.default_rng(0))
        assert selection.is_empty
        assert selection.level_index == (-1,) * len(stacks)
        assert selection.note == "no candidate surface has a point"
        assert len(selection.losses) == len(stacks)


def test_an_empty_component_beside_a_full_one(scan: Measurement) -> None:
    selection = select_levels(
        [NOTHING, caps()], [0, NUM_LEVELS], scan, SETTINGS, rng=np.random.default_rng(0)
    )
    assert selection.level_index[0] == -1
    assert abs(selection.level_index[1] - TRUE_LEVEL) <= 1
    assert selection.losses[0].shape == (0,)


def test_zero_signal_gives_an_empty_choice_with_its_reason(scan: Measurement) -> None:
    selection = choose(dataclasses.replace(scan, h=0 * scan.h))
    assert selection.is_empty
    assert selection.note == "the signal is zero in the range of the candidates"


def test_an_echo_at_the_end_of_the_window_falls_back_and_says_so(scan: Measurement) -> None:
    selection = choose(dataclasses.replace(scan, range_bias_m=-0.5))  # as if 0.25 m behind the candidates
    assert not selection.is_empty
    assert selection.note.startswith("no antenna has a clear echo")


def test_bad_input_is_refused(scan: Measurement) -> None:
    stack = caps()
    broken = scan.h.copy()
    broken[3, 4] = np.nan
    with pytest.raises(RadarError, match="non-finite samples"):
        choose(dataclasses.replace(scan, h=broken))
    cases = {
        "non-finite points_m": dataclasses.replace(stack, points_m=stack.points_m * np.nan),
        "non-finite normals": dataclasses.replace(stack, normals=stack.normals * np.inf),
        "ascending levels": dataclasses.replace(stack, level=stack.level[::-1]),
        "levels from 0 to 24": dataclasses.replace(stack, level=stack.level + 1),
        "positive areas": dataclasses.replace(stack, areas_m2=0 * stack.areas_m2),
    }
    for message, bad in cases.items():
        with pytest.raises(RadarError, match=message):
            select_levels([bad], [NUM_LEVELS], scan, SETTINGS, rng=np.random.default_rng(0))
    with pytest.raises(RadarError, match="as many level counts"):
        select_levels([stack], [], scan, SETTINGS, rng=np.random.default_rng(0))
    with pytest.raises(ValidationError, match="colour"):
        SelectionSettings(colour="red")
    with pytest.raises(ValidationError, match='no phase: with coherent = false take loss = "magnitude"'):
        SelectionSettings(coherent=False)
    with pytest.raises(ValidationError, match='"last_peak" are made for loss = "magnitude"'):
        SelectionSettings(choice="last_peak")
