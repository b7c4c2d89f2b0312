"""The signals that the studies of surfaces measure on: the clean scans of a twin, spoilt in several ways."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from waveformer.datagen.twin_store import TwinScan, twin_scans
from waveformer.model.imaging_volume import Volume
from waveformer.simulator import Aperture, FrontEnd, Measurement
from waveformer.simulator.front_end_chain import apply_front_end


def scans_of(root: Path, condition: str) -> Iterator[TwinScan]:
    """Finished scans of one condition, in the order of their objects."""
    return (scan for scan in twin_scans(root) if scan.condition == condition)


def with_noise(scan: Measurement, mirror_snr_db: float, seed: int) -> Measurement:
    """White noise so far below the signal of a mirror at 0.4 m."""
    front_end = FrontEnd(mirror_snr_db=mirror_snr_db)
    h = apply_front_end(front_end, scan.h, 0, scan.aperture, scan.chirp, seed)
    return dataclasses.replace(scan, h=h)


def sparse(scan: Measurement, rng: np.random.Generator) -> Measurement:
    """A random eighth of the antennas."""
    rows = np.sort(rng.choice(len(scan.aperture), len(scan.aperture) // 8, replace=False))
    return dataclasses.replace(scan, h=scan.h[rows], aperture=Aperture(scan.aperture.tx_m[rows]))


def wrong_depth(scan: Measurement, rng: np.random.Generator) -> Measurement:
    """A range bias that nobody knows of, 15 to 30 mm of path either way."""
    bias_m = rng.choice([-1.0, 1.0]) * rng.uniform(0.015, 0.03)
    return dataclasses.replace(scan, range_bias_m=scan.range_bias_m + float(bias_m))


def crop_of(scan: TwinScan) -> Volume:
    """What is imaged of a scan."""
    return Volume(*scan.crop_m)
