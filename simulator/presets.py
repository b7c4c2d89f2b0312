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
}


def lookup_preset(kind: str, presets: Mapping[str, dict[str, Any]], name: str) -> dict[str, Any]:
    """The preset called `name`; raises RadarError naming the known ones."""
    if name not in presets:
        raise RadarError(f"unknown {kind} preset {name!r}; known: {', '.join(presets)}")
    return dict(presets[name])
