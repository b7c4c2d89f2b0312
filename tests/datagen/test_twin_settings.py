"""The common settings of a twin."""

import json

import numpy as np
import pytest

from waveformer.datagen.twin_settings import TwinSettings
from waveformer.simulator.errors import RadarError
from waveformer.simulator.presets import APERTURE_PRESETS, CHIRP_PRESETS


def test_defaults_are_mitos_raster_and_band():
    settings = TwinSettings()
    assert len(settings.aperture) == 76 * 101 == 7676
    assert np.ptp(settings.aperture.tx_m, axis=0) == pytest.approx([0.30, 0.40, 0.0])
    assert settings.aperture.is_monostatic
    preset = CHIRP_PRESETS["mito"]
    assert (settings.chirp.start_hz, settings.chirp.bandwidth_hz) == (
        preset["start_hz"],
        preset["bandwidth_hz"],
    )
    assert {name: getattr(settings, name) for name in ("num_x", "num_y", "spacing_m")} == APERTURE_PRESETS[
        "mito"
    ]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"spacing_m": 0.005}, "5 mm aliases"),
        ({"spacing_m": 0.0}, "positive counts and spacing"),
        ({"num_x": 0}, "positive counts"),
        ({"mode": "magic"}, "known: fast, exact"),
        ({"support_z_m": 0.1}, "below the aperture"),
        ({"support_z_m": float("nan")}, "below the aperture"),
        ({"tessellation": 5}, "0 .. 4"),
        ({"tessellation": -1}, "0 .. 4"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_refusals(values, expected):
    with pytest.raises(RadarError, match=expected):
        TwinSettings(**values)


def test_four_millimetres_and_finer_pass():
    assert len(TwinSettings(spacing_m=0.002, num_x=3, num_y=2).aperture) == 6


def test_reflectivity_is_the_objects_own():
    names = [f"object {number}" for number in range(200)]
    drawn = [TwinSettings().reflectivity(name) for name in names]
    assert min(drawn) >= 0.15
    assert max(drawn) <= 1.0
    # uniform: the mean of 200 draws from 0.15 .. 1 is 0.575, with standard deviation 0.245 / sqrt(200) = 0.017
    assert np.mean(drawn) == pytest.approx(0.575, abs=4 * 0.017)
    assert TwinSettings(mode="fast").reflectivity(names[3]) == drawn[3]
    assert TwinSettings(seed=1).reflectivity(names[3]) != drawn[3]


def test_front_end_seeds_differ_between_objects_and_seeds():
    seeds = {TwinSettings(seed=seed).front_end_seed(name) for seed in (0, 1) for name in "abcd"}
    assert len(seeds) == 8


def test_description_is_json_and_complete():
    described = TwinSettings(seed=3).describe()
    assert json.loads(json.dumps(described)) == described
    for change in ({"seed": 4}, {"num_y": 8}, {"mode": "fast"}, {"tessellation": 0}, {"support_z_m": -0.4}):
        assert TwinSettings(**{"seed": 3, **change}).describe() != described
