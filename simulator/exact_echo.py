"""The echo of one target pair by pair: visibility traced per antenna position, no bins, no tiles.

Slower by orders of magnitude than `fast_echo` and the judge of it: the only thing they share is the
integrand (`echo_terms`) and the quadrature. Its own oracle is `reference.dense_echo` (float64).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.echo_terms import Leg, echo
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.kernel_direct import frequency_nodes, sum_pairs
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.quadrature import SurfaceSamples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import reference_phase
from waveformer.simulator.scene import VISIBLE, SampleTable, sample_states

_MAX_PAIRS = 1 << 22


def exact_echo(
    scene: Any,
    samples: SurfaceSamples,
    two_sided: bool,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
    tile_positions: int | None,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Sum the echo of one target, a group of antenna positions at a time.

    Arguments as in `fast_echo.fast_echo`.
    """
    wavelength = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    center = 0.5 * (samples.points_m.min(axis=0) + samples.points_m.max(axis=0))
    radius = float(np.sqrt(((samples.points_m - center) ** 2).sum(axis=1).max()))
    frequencies, to_samples = frequency_nodes(chirp, radius, numerics.tolerance)
    taper = taper_scale(samples, wavelength, numerics.facet_taper)
    table = np.concatenate(
        [samples.points_m - center, samples.normals, samples.areas_m2[:, None], taper[:, None]], axis=1
    )

    traced = SampleTable(samples.points_m, samples.normals)

    def integrand(legs: list[Leg], area: Any, taper: Any) -> tuple[Any, Any]:
        return echo(legs[0], legs[1] if len(legs) > 1 else None, area, taper, two_sided)

    rows_per_group = max(1, _MAX_PAIRS // len(samples.points_m))
    if tile_positions is not None:
        rows_per_group = min(rows_per_group, tile_positions)
    for start in range(0, len(aperture), rows_per_group):
        rows = np.arange(start, min(start + rows_per_group, len(aperture)))
        receivers = None if aperture.rx_m is None else aperture.rx_m[rows]
        states = sample_states(scene, traced, two_sided, aperture.tx_m[rows], receivers)
        seen = np.flatnonzero((states == VISIBLE).any(axis=0))
        if len(seen) == 0:
            continue
        at_nodes = sum_pairs(
            table[seen],
            states[:, seen] == VISIBLE,
            aperture.tx_m[rows] - center,
            None if receivers is None else receivers - center,
            frequencies,
            integrand,
        )
        add(
            rows,
            (at_nodes @ to_samples).astype(np.complex64) * reference_phase(chirp, aperture, rows, center),
        )
