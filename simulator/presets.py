"""Named radars and apertures, each value with its unit in the key and its source beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from waveformer.simulator.errors import RadarError

CHIRP_PRESETS: dict[str, dict[str, Any]] = {
    # MITO and mmNorm, TI IWR1443BOOST: 512 samples at 10 MS/s, 5 861 160 Hz per sample.
    "mito": {"start_hz": 77.5001e9, "bandwidth_hz": 3.0009e9, "num_samples": 512},
    # The full automotive band of 77 GHz radars (ETSI EN 302 264), 256 samples.
    "77-81ghz": {"start_hz": 77.0e9, "bandwidth_hz": 4.0e9, "num_samples": 256},
    # MITO's second radar, 24 GHz ISM band: 200 MHz, 256 samples.
    "24ghz": {"start_hz": 24.025e9, "bandwidth_hz": 0.2e9, "num_samples": 256},
}

APERTURE_PRESETS: dict[str, dict[str, Any]] = {
    # A quick look: 18 x 18 cm at 3 mm, for the demo and first experiments.
    "small": {"num_x": 60, "num_y": 60, "spacing_m": 0.003},
    # The extent of MITO's almost-square scan, regular at 4 mm: N = 7676. Coarser pitches alias.
    "mito": {"num_x": 76, "num_y": 101, "spacing_m": 0.004},
    # One position at the origin: a single range profile.
    "single": {"num_x": 1, "num_y": 1, "spacing_m": 0.001},
    # The grid of MITO's own simulator, "same as real": a quarter of the wavelength at 77.5001 GHz,
    # 299 792 458 / 77.5001e9 / 4 m, so 0.222 x 0.549 m, N = 130 640. MITO's first index is x, here x runs
    # fastest, and its plane lies 0.20 m above the middle of the mesh's box.
    "mito_quarter_wave": {"num_x": 230, "num_y": 568, "spacing_m": 299_792_458.0 / 77.5001e9 / 4},
}

RASTER_PRESETS: dict[str, dict[str, Any]] = {
    # MITO's experiment 2, almost-square aperture: about 44 000 positions over about 0.30 x 0.40 m, rows along
    # x. The recordings fix the rest. One file is one row and holds 4000 frames of 3 ms, so the robot takes 12 s
    # for 0.30 m and a frame comes every 75 um. A frame nearer than 3/16 wavelength (0.7253 mm) to a kept one
    # is dropped, so every tenth is kept: a step of 0.750 mm and 401 positions a row. 44 000 / 401 gives 110
    # rows, 0.40 m / 109 = 3.67 mm apart, just under a wavelength. N = 44 110.
    "mito_raster": {"row_length_m": 0.30, "num_rows": 110, "step_m": 0.00075, "row_spacing_m": 0.40 / 109},
}


def lookup_preset(kind: str, presets: Mapping[str, dict[str, Any]], name: str) -> dict[str, Any]:
    """The preset called `name`; raises RadarError naming the known ones."""
    if name not in presets:
        raise RadarError(f"unknown {kind} preset {name!r}; known: {', '.join(presets)}")
    return dict(presets[name])
