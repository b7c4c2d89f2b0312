"""The echo of one target pair by pair: visibility traced per antenna position, no bins, no tiles.

Slower by orders of magnitude than `fast_echo` and the judge of it: the only thing they share is the
integrand (`echo_terms`) and the quadrature. Its own oracle is `reference.dense_echo` (float64).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.backend import Array3f, Float
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.echo_terms import Leg, echo
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.kernel_direct import frequency_nodes, sum_pairs
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.range_bins import reference_phase
from waveformer.simulator.response import Response
from waveformer.simulator.scene import VISIBLE, SampleTable, sample_states

_MAX_PAIRS = 1 << 22


def exact_echo(
    scene: Any,
    source: EchoSource,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
    tile_positions: int | None,
    add: Callable[[NDArray[np.int64], NDArray[np.complex64]], None],
) -> None:
    """Sum the echo of one target, a group of antenna positions at a time.

    Arguments as in `fast_echo.fast_echo`.
    """
    samples, two_sided = source.samples, source.two_sided
    wavelength = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    center = 0.5 * (samples.points_m.min(axis=0) + samples.points_m.max(axis=0))
    radius = float(np.sqrt(((samples.points_m - center) ** 2).sum(axis=1).max()))
    frequencies, to_samples = frequency_nodes(
        chirp, radius + response_depth_m(source, chirp), numerics.tolerance
    )
    response = (
        None if source.response is None else Response(replace(source.response, frequencies_hz=frequencies))
    )
    middle = Array3f(*(dr.opaque(Float, float(value)) for value in center))
    taper = taper_scale(samples, wavelength, numerics.facet_taper)
    table = np.concatenate(
        [samples.points_m - center, samples.normals, samples.areas_m2[:, None], taper[:, None]], axis=1
    )

    traced = SampleTable(samples.points_m, samples.normals)

    def integrand(legs: list[Leg], point: Any, normal: Any, area: Any, taper: Any) -> tuple[Any, Any, Any]:
        back = legs[1] if len(legs) > 1 else None
        amplitude, excess, cosine = echo(legs[0], back, area, taper, two_sided)
        if response is None:
            return amplitude, excess, None

        def weight(entry: Any) -> Any:
            path = response.path(middle + point, legs, entry)
            return response.surface(legs, cosine, normal, entry) * path

        return amplitude, excess, weight

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
            weighted=response is not None,
        )
        add(
            rows,
            (at_nodes @ to_samples).astype(np.complex64) * reference_phase(chirp, aperture, rows, center),
        )


def response_depth_m(source: EchoSource, chirp: Chirp) -> float:
    """How much deeper than the target its echo seems, in metres: inner echoes of walls arrive late.

    The third inner echo of a wall is below 1e-3 of the first for permittivities up to 4.
    """
    if source.response is None:
        return 0.0
    surroundings, material = source.response.surroundings, source.response.material
    walls = [sheet.material for sheet in surroundings.sheets] + [material]
    if surroundings.box is not None:
        walls += 2 * [surroundings.box.material]
    depths_m = (
        3.0 * wall.thickness_m * abs(wall.permittivity.at(chirp.center_hz)) ** 0.5
        for wall in walls
        if wall.thickness_m is not None and wall.permittivity is not None
    )
    return float(sum(depths_m))
