"""Exact mode: pairs per second with its rays and of its sum alone, and the dense NumPy sum beside it."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np
from scenes import APERTURE, CHIRP, Surface, bumpy_ellipsoid, measure, relative_l2, report

from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.echo_terms import echo
from waveformer.simulator.exact_echo import exact_echo
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.kernel_direct import frequency_nodes, sum_pairs
from waveformer.simulator.numerics import EXACT
from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture
from waveformer.simulator.reference import dense_echo
from waveformer.simulator.scene import VISIBLE, SampleTable, sample_states

_WAVELENGTH_M = SPEED_OF_LIGHT_M_PER_S / CHIRP.center_hz


def run_exact(surface: Surface, samples: SurfaceSamples, aperture: Aperture) -> Any:
    """Exact mode from samples to (N, T), rays included."""
    h = np.zeros((len(aperture), CHIRP.num_samples), dtype=np.complex64)

    def add(rows: Any, part: Any) -> None:
        h[rows] += part

    exact_echo(
        surface.scene, EchoSource(samples, False, surface.closest_m), CHIRP, aperture, EXACT, None, add
    )
    return h


def sum_alone(samples: SurfaceSamples, visible: Any, aperture: Aperture) -> Any:
    """The sum of exact mode for visibility that is known, as (N, frequency nodes)."""
    center = 0.5 * (samples.points_m.min(axis=0) + samples.points_m.max(axis=0))
    offsets = samples.points_m - center
    radius = float(np.linalg.norm(offsets, axis=1).max())
    taper = taper_scale(samples, _WAVELENGTH_M, EXACT.facet_taper)
    table = np.concatenate([offsets, samples.normals, samples.areas_m2[:, None], taper[:, None]], axis=1)
    frequencies, _ = frequency_nodes(CHIRP, radius, EXACT.tolerance)
    return sum_pairs(
        table,
        visible,
        aperture.tx_m - center,
        None,
        frequencies,
        lambda legs, _point, _normal, area, scale: (*echo(legs[0], None, area, scale, False)[:2], None),
    )


def main(quick: bool) -> None:
    surface = Surface(bumpy_ellipsoid(), EXACT)
    aperture = replace(APERTURE, tx_m=APERTURE.tx_m[:: 150 if quick else 75])
    samples = surface.samples
    visible = (
        sample_states(
            surface.scene, SampleTable(samples.points_m, samples.normals), False, aperture.tx_m, None
        )
        == VISIBLE
    )
    pairs = int(visible.sum())
    runs = 3 if quick else 5
    whole = measure(lambda: run_exact(surface, samples, aperture), runs).rate(pairs)
    alone = measure(lambda: sum_alone(samples, visible, aperture), runs).rate(pairs)

    # the dense sum holds every sample at every frequency: some samples, few antennas
    some = np.arange(0, len(samples.points_m), 16)
    thin, few = take(samples, some), replace(aperture, tx_m=aperture.tx_m[::6])
    seen = visible[::6, some]
    taper = taper_scale(thin, _WAVELENGTH_M, EXACT.facet_taper)
    dense = dense_echo(thin, taper, CHIRP, few, seen, False)
    error = relative_l2(run_exact(surface, thin, few), dense)
    numpy = measure(lambda: dense_echo(thin, taper, CHIRP, few, seen, False), 3).rate(int(seen.sum()))
    report(
        [
            {"name": "exact mode with its rays", **whole, "relative_l2_error": error},
            {"name": "exact mode, the sum alone", **alone},
            {
                "name": "NumPy float64, every pair and every sample",
                **numpy,
                "slower_than_kernel": alone["pairs_per_cpu_s"] / numpy["pairs_per_cpu_s"],
                "relative_l2_error": 0.0,
            },
        ]
    )


if __name__ == "__main__":
    main("--quick" in sys.argv)
