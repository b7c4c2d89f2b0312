"""The front end as a whole: what is off, in which order things happen, blocks, seeds, presets, refusals."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from waveformer.simulator.arrays import with_receivers
from waveformer.simulator.closed_forms import infinite_plane, point_scatterer
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end import FRONT_END_PRESETS, FrontEnd
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.front_end_noise import signal_power
from waveformer.simulator.front_end_positions import true_aperture
from waveformer.simulator.front_end_settings import DcOffset, IqImbalance, Leakage, TableClutter
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp

CHIRP = Chirp(77e9, 4e9, 64)
PAIRS = with_receivers(Aperture.planar_grid(17, 11, 0.004), "mito")
RANGES = [np.linalg.norm(way - [0.01, 0.0, -0.4], axis=1)[:, None] for way in (PAIRS.tx_m, PAIRS.receivers_m)]
ECHO = point_scatterer(1e-3, *RANGES, CHIRP.frequencies_hz).astype(np.complex64)

EVERYTHING = {
    "snr_db": 25.0,
    "sample_rate_hz": 10e6,
    "position_jitter_m": 1e-5,
    "row_depth_error_m": 1e-4,
    "range_bias_m": 0.15,
    "table": {"z_m": -0.45, "reflection": -0.1},
    "room": {"count": 5, "rcs_m2": 1e-3, "min_m": [-1, -1, -1.5], "max_m": [1, 1, -1]},
    "leakage": {"level_db": -70.0, "path_m": 0.02},
    "interferer": {"slope_hz_per_s": 1e12, "level_db": -60.0, "filter_hz": 4e6},
    "phase_noise": {"level_dbc_hz": -90.0},
    "iq_imbalance": {"gain_db": 0.3, "phase_deg": 2.0},
    "dc_offset": {"level_db": -80.0, "phase_deg": 45.0},
    "adc": {"bits": 12, "full_scale_db": -50.0},
}


def apply(settings: Any, seed: int = 0, h: np.ndarray = ECHO, aperture: Aperture = PAIRS) -> np.ndarray:
    front_end = FrontEnd.model_validate(settings)
    return apply_front_end(front_end, h, 0, aperture, CHIRP, seed)


def test_an_ideal_front_end_changes_nothing() -> None:
    assert FrontEnd().is_ideal
    assert FrontEnd() == FrontEnd.from_preset("ideal")
    assert (apply({}) == ECHO).all()
    assert (apply({"sample_rate_hz": 1e7}) == ECHO).all()
    assert true_aperture(FrontEnd(), PAIRS, 0) is PAIRS


@pytest.mark.parametrize("name", sorted(set(EVERYTHING) - {"sample_rate_hz"}))
def test_each_impairment_does_something_and_leaves_its_input_alone(name: str) -> None:
    given = ECHO.copy()
    front_end = FrontEnd.model_validate({"sample_rate_hz": 10e6, name: EVERYTHING[name]})
    assert not front_end.is_ideal
    moved = true_aperture(front_end, PAIRS, seed=0)
    recorded = apply_front_end(front_end, given, 0, moved, CHIRP, seed=0)
    assert recorded.dtype == np.complex64
    assert recorded.shape == ECHO.shape
    assert (given == ECHO).all()
    assert moved is not PAIRS if name.endswith(("jitter_m", "error_m")) else (recorded != ECHO).any()


def test_blocks_of_rows_give_the_same_bytes_as_the_whole() -> None:
    front_end = FrontEnd.model_validate(EVERYTHING)
    whole = apply_front_end(front_end, ECHO, 0, PAIRS, CHIRP, seed=4)
    reference = float(np.median(signal_power(ECHO)))
    for size in (1, 3, 100, 256, 700):
        first_rows = range(0, len(ECHO), size) if size > 1 else (0, 1, 255, 256, 257, len(ECHO) - 1)
        for first in first_rows:
            block = ECHO[first : first + size]
            recorded = apply_front_end(
                front_end, block, first, PAIRS, CHIRP, seed=4, reference_power=reference
            )
            assert (recorded == whole[first : first + size]).all(), (size, first)


def test_the_seed_decides_everything_random() -> None:
    random = {
        name: EVERYTHING[name] for name in ("snr_db", "sample_rate_hz", "room", "interferer", "phase_noise")
    }
    assert (apply(random, seed=0) == apply(random, seed=0)).all()
    assert (apply(random, seed=0) != apply(random, seed=1)).all()


def test_one_impairment_does_not_change_the_random_numbers_of_another() -> None:
    noise = apply({"mirror_snr_db": 30.0}) - ECHO
    both = {"mirror_snr_db": 30.0, "dc_offset": {"level_db": -90.0}, "leakage": {"level_db": -80.0}}
    without = {name: both[name] for name in ("dc_offset", "leakage")}
    # rounding of single precision
    assert np.abs(apply(both) - apply(without) - noise).max() < 1e-9


def test_range_bias_delays_echo_and_clutter_but_not_the_leakage() -> None:
    delay = np.exp(-2j * np.pi * CHIRP.frequencies_hz * 0.15 / SPEED_OF_LIGHT_M_PER_S)
    clutter = {"table": TableClutter(z_m=-0.45, reflection=-0.2)}
    leak = {"leakage": Leakage(level_db=-80.0)}
    together = apply({"range_bias_m": 0.15, **clutter, **leak})
    assert np.abs(together - (apply(clutter) * delay + 1e-4)).max() < 1e-9


def test_imbalance_sees_the_leakage_but_neither_noise_nor_dc_offset() -> None:
    imbalance = {"iq_imbalance": IqImbalance(gain_db=6.0)}
    silence = 0 * ECHO
    leak = {"leakage": Leakage(level_db=-80.0, path_m=0.02)}
    quadrature = apply(leak | imbalance, h=silence).imag / apply(leak, h=silence).imag
    assert quadrature == pytest.approx(10 ** (6 / 20), rel=1e-4)
    offset = {"dc_offset": DcOffset(level_db=-80.0, phase_deg=90.0)}
    assert apply(offset | imbalance, h=silence) == pytest.approx(1e-4j, rel=1e-5)
    noise = {"mirror_snr_db": 30.0}
    assert (apply(noise | imbalance, h=silence) == apply(noise, h=silence)).all()


def test_converter_comes_last() -> None:
    recorded = apply(EVERYTHING | {"adc": {"bits": 6, "full_scale_db": -75.0}})
    step = 10 ** (-75 / 20) / 32
    codes = recorded.view(np.float32) / step
    assert np.abs(codes - np.round(codes)).max() < 1e-4
    assert codes.min() == pytest.approx(-32)
    assert codes.max() == pytest.approx(31)


def test_clutter_comes_from_where_the_antennas_really_were() -> None:
    front_end = FrontEnd(row_depth_error_m=3e-4, table=TableClutter(z_m=-0.45, reflection=-1.0))
    nominal = Aperture.planar_grid(4, 5, 0.01)
    moved = true_aperture(front_end, nominal, seed=0)
    silence = np.zeros((20, 64), dtype=np.complex64)
    recorded = apply_front_end(front_end, silence, 0, moved, CHIRP, seed=0)
    expected = infinite_plane(0.45 + moved.tx_m[:, 2:], CHIRP.frequencies_hz)
    assert np.abs(recorded - expected).max() < 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("name", FRONT_END_PRESETS)
def test_presets_describe_themselves_as_json_that_makes_them_again(name: str) -> None:
    front_end = FrontEnd.from_preset(name)
    described = front_end.describe()
    assert json.loads(json.dumps(described)) == described
    assert FrontEnd(**described) == front_end


def test_mito_presets_carry_the_published_bias_and_the_occluded_one_is_worse() -> None:
    seen, occluded = FrontEnd.from_preset("mito_los"), FrontEnd.from_preset("mito_nlos")
    assert seen.range_bias_m == occluded.range_bias_m == 0.15
    assert (seen.mirror_snr_db or 0) > (occluded.mirror_snr_db or 0)
    assert (seen.row_depth_error_m, occluded.row_depth_error_m) == (0.0, 2e-4)


def test_a_mirror_does_not_saturate_the_radar_preset() -> None:
    board = FrontEnd.from_preset("iwr1443")
    mirror = 10 ** (21 / 20) * np.abs(infinite_plane(0.4, CHIRP.frequencies_hz)).max()
    assert board.adc is not None
    assert mirror < 10 ** (board.adc.full_scale_db / 20)


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({"snr_db": 20.0, "mirror_snr_db": 30.0}, "snr_db and mirror_snr_db"),
        (
            {"mirror_snr_db": 3.0, "noise_figure_db": 3.0, "transmit_power_dbm": 1.0},
            "mirror_snr_db and noise_figure",
        ),
        ({"noise_figure_db": 15.0}, "transmit_power_dbm"),
        ({"transmit_power_dbm": 12.0}, "noise_figure_db"),
        ({"noise_figure_db": 15.0, "transmit_power_dbm": 12.0}, "sample_rate_hz"),
        ({"phase_noise": {"level_dbc_hz": -90.0}}, "sample_rate_hz"),
        ({"interferer": EVERYTHING["interferer"]}, "sample_rate_hz"),
        ({"interferer": EVERYTHING["interferer"], "sample_rate_hz": 5e6}, "filter_hz"),
        ({"snr": 20.0}, "unknown snr; known: snr_db, mirror_snr_db"),
        ({"adc": {"bitz": 12, "full_scale_db": 0.0}}, "unknown bitz; known: bits, full_scale_db"),
        ({"adc": {"bits": 24, "full_scale_db": 0.0}}, r"Adc\.bits"),
        ({"adc": {}}, r"Adc\.full_scale_db"),
        ({"snr_db": float("nan")}, "snr_db"),
        ({"snr_db": "20"}, "snr_db"),
        ({"position_jitter_m": -1e-3}, "position_jitter_m"),
        ({"table": {"z_m": -0.4, "reflection": -1.1}}, "reflection"),
        ({"room": EVERYTHING["room"] | {"min_m": [2, -1, -2]}}, "min_m"),  # type: ignore[operator]
        ({"iq_imbalance": {"phase_deg": 90.0}}, "phase_deg"),
        ({"leakage": {"level_db": 3.0}}, "level_db"),
    ],
)
def test_nonsense_is_refused_by_name(settings: dict[str, Any], names: str) -> None:
    with pytest.raises(RadarError, match=names) as refusal:
        FrontEnd.model_validate(settings)
    assert "\n" not in str(refusal.value)


def test_front_end_is_frozen_and_presets_are_known_by_name() -> None:
    with pytest.raises(ValueError, match="frozen"):
        FrontEnd().snr_db = 3.0
    with pytest.raises(RadarError, match="mito_nlos"):
        FrontEnd.from_preset("mito")


@pytest.mark.parametrize(("first", "rows"), [(-1, 5), (len(ECHO) - 2, 5), (0, 0)])
def test_a_block_outside_the_aperture_is_refused(first: int, rows: int) -> None:
    with pytest.raises(RadarError, match="does not fit"):
        apply_front_end(FrontEnd(), ECHO[:rows], first, PAIRS, CHIRP, seed=0)


def test_import_loads_no_kernel() -> None:
    code = (
        "import sys, waveformer.simulator.front_end_chain\n"
        "print(sorted(set(sys.modules) & {'mitsuba', 'drjit', 'torch', 'scipy', 'trimesh'}))"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "[]"
