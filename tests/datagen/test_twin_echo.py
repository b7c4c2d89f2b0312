"""Signals of the twin against `simulate` called by hand."""

import numpy as np
import pytest
import trimesh

from waveformer.datagen.twin_conditions import CONDITIONS
from waveformer.datagen.twin_echo import ideal_echo, record
from waveformer.datagen.twin_objects import TwinObject
from waveformer.datagen.twin_scene import TwinScene
from waveformer.datagen.twin_settings import TwinSettings
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.errors import MeshError
from waveformer.simulator.forward import simulate
from waveformer.simulator.front_end_noise import mirror_power
from waveformer.simulator.target import Target

SETTINGS = TwinSettings(num_x=6, num_y=5)
PLAIN = TwinSettings(num_x=6, num_y=5, tessellation=0)


@pytest.fixture
def scene(tmp_path, mitsuba_variant):
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(subdivisions=4, radius=0.02).export(path)
    return TwinScene.load(TwinObject("ball", path), SETTINGS)


def by_hand(scene, settings, **arguments):
    target = Target(scene.item.path, pose=scene.pose)
    return simulate(target, settings.chirp, settings.aperture, mode=settings.numerics, **arguments).h


def error(h, expected):
    return np.linalg.norm(h - expected) / np.linalg.norm(expected)


def recorded(scene, settings, name):
    condition = CONDITIONS[name]
    return record(scene, ideal_echo(scene, condition, settings), condition, settings, {})


# Single-precision sums of the same samples without those that no antenna sees.
ROUNDING = 1e-5


def test_clean_is_the_echo_times_the_reflectivity(scene):
    measurement = recorded(scene, PLAIN, "clean")
    assert error(measurement.h, scene.reflectivity * by_hand(scene, PLAIN)) < ROUNDING
    assert measurement.metadata["front_end"] == {}
    assert measurement.metadata["targets"][0]["bounds_m"][0][2] == pytest.approx(-0.45)


def test_the_sheet_echoes_at_its_own_strength(scene):
    sheet = CONDITIONS["sheet"].sheet
    echo = ideal_echo(scene, CONDITIONS["sheet"], PLAIN)
    both = by_hand(scene, PLAIN, sheets=[sheet])
    silent = by_hand(
        scene, PLAIN, sheets=[type(sheet)(sheet.point_m, sheet.normal, sheet.thickness_m, sheet.permittivity)]
    )
    assert error(echo.h, scene.reflectivity * silent + (both - silent)) < ROUNDING
    # lambda / (8 pi d) |Gamma| of an infinite plane, at 0.26 m
    wavelength_m = PLAIN.chirp.wavelengths_m
    assert np.abs(both - silent)[12] == pytest.approx(0.1 * wavelength_m / (8 * np.pi * 0.26), rel=2e-3)
    assert echo.description["surroundings"]["sheets"][0]["echo"]


def test_rows_move_the_antennas_but_not_what_is_written(scene):
    front_end, seed = CONDITIONS["rows"].front_end, PLAIN.front_end_seed("ball")
    echo = ideal_echo(scene, CONDITIONS["rows"], PLAIN)
    shift_m = echo.antennas.tx_m - PLAIN.aperture.tx_m
    assert (shift_m[:, :2] == 0).all()
    assert len(np.unique(shift_m[:, 2])) == 5  # one error a row
    noiseless = front_end.model_copy(update={"mirror_snr_db": None})
    assert (
        error(echo.h, scene.reflectivity * by_hand(scene, PLAIN, front_end=noiseless, seed=seed)) < ROUNDING
    )
    measurement = recorded(scene, PLAIN, "rows")
    assert (measurement.aperture.tx_m == PLAIN.aperture.tx_m).all()


def test_noise_has_the_level_of_its_name(scene):
    clean, noisy = (recorded(scene, PLAIN, name).h for name in ("clean", "m30"))
    # a bin's mean noise power is 30 dB below the mirror's peak; a sample has T times that of a bin
    mirror = mirror_power(PLAIN.chirp, Antenna.isotropic())
    expected = PLAIN.chirp.num_samples * mirror * 1e-3
    # 30 x 64 exponential powers: standard deviation 1 / sqrt(1920) = 2.3 %
    assert np.mean(np.abs(noisy - clean) ** 2) == pytest.approx(expected, rel=4 * 0.023)
    # paired: the same noise at another level
    quieter = recorded(scene, PLAIN, "m40").h
    assert error(quieter - clean, (noisy - clean) * 10**-0.5) < 1e-4


def test_another_tessellation_has_nearly_the_same_echo(scene):
    whole, divided = (ideal_echo(scene, CONDITIONS["clean"], settings).h for settings in (PLAIN, SETTINGS))
    # pieces of a third of a wavelength carry an error of about 1 % (against a quarter: 0.6 - 0.8 % on scans)
    assert 1e-5 < error(divided, whole) < 0.02


def test_the_fast_mode_agrees(scene):
    fast = TwinSettings(num_x=6, num_y=5, mode="fast")
    exact = ideal_echo(scene, CONDITIONS["clean"], SETTINGS).h
    # the same pieces: what remains is visibility by sub-aperture and the fast kernel, 1e-3 each of the whole
    assert error(ideal_echo(scene, CONDITIONS["clean"], fast).h, exact) < 0.01


def test_an_object_higher_than_the_sheet_is_refused(tmp_path):
    path = tmp_path / "tower.ply"
    trimesh.creation.box((0.02, 0.02, 0.2)).export(path)
    scene = TwinScene.load(TwinObject("tower", path), SETTINGS)
    with pytest.raises(MeshError, match="through the sheet"):
        ideal_echo(scene, CONDITIONS["box"], SETTINGS)
