"""Ideal point scatterers: the signal every other model is compared with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from waveformer.simulator.clusters import group_into_cells
from waveformer.simulator.errors import RadarError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.range_bins import reference_phase
from waveformer.simulator.runtime import activate

if TYPE_CHECKING:
    from waveformer.simulator.echo_terms import Leg

_MAX_PAIRS = 1 << 22
_TOLERANCE = 1e-6
# Single precision resolves range differences within a cluster of this size to 1e-4 rad.
_CLUSTER_EDGE_M = 0.5


def simulate_points(points_m: ArrayLike, rcs_m2: ArrayLike, chirp: Chirp, aperture: Aperture) -> Measurement:
    """Signal of isotropic point scatterers, unobstructed.

    A point of radar cross-section sigma gives h = sqrt(sigma) lambda / ((4 pi)^1.5 R_tx R_rx)
    exp(-j k (R_tx + R_rx)) with isotropic antennas of unit gain.

    Args:
        points_m: shape (M, 3), radar frame.
        rcs_m2: radar cross-sections, shape (M,) or one number.
        chirp, aperture: the radar.

    Returns:
        Measurement with h of shape (N, T).

    Raises:
        RadarError: shapes do not fit, a cross-section is negative, or a point lies on an antenna or
            beyond the unambiguous range.
    """
    try:
        points = np.asarray(points_m, dtype=np.float64)
    except (TypeError, ValueError):
        raise RadarError("points_m must be numbers of shape (M, 3), in metres") from None
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0 or not np.isfinite(points).all():
        raise RadarError(f"points_m must be finite metres of shape (M, 3), M >= 1, got shape {points.shape}")
    try:
        rcs = np.broadcast_to(np.asarray(rcs_m2, dtype=np.float64), (len(points),))
    except ValueError:
        raise RadarError(f"rcs_m2 must be one number or one per point ({len(points)})") from None
    if not (np.isfinite(rcs).all() and (rcs >= 0).all()):
        raise RadarError("rcs_m2 must be finite and not negative")
    _check_ranges(points, chirp, aperture)

    activate()
    from waveformer.simulator.kernel_direct import frequency_nodes, sum_pairs

    h = np.zeros((len(aperture), chirp.num_samples), dtype=np.complex64)
    cells = group_into_cells(points, _CLUSTER_EDGE_M)
    for members in np.split(cells.order, cells.starts[1:-1]):
        cluster = points[members]
        center = 0.5 * (cluster.min(axis=0) + cluster.max(axis=0))
        radius = float(np.linalg.norm(cluster - center, axis=1).max())
        frequencies, to_samples = frequency_nodes(chirp, radius, _TOLERANCE)
        normals = np.tile([0.0, 0.0, 1.0], (len(cluster), 1))  # unused: a point has no orientation
        weights = np.sqrt(rcs[members])[:, None]
        table = np.concatenate([cluster - center, normals, weights, np.zeros((len(cluster), 1))], axis=1)
        step = max(1, _MAX_PAIRS // len(cluster))
        for start in range(0, len(aperture), step):
            rows = np.arange(start, min(start + step, len(aperture)))
            receivers = None if aperture.rx_m is None else aperture.rx_m[rows] - center
            everything = np.ones((len(rows), len(cluster)), dtype=bool)
            sums = sum_pairs(table, everything, aperture.tx_m[rows] - center, receivers, frequencies, _point)
            h[rows] += (sums @ to_samples) * reference_phase(chirp, aperture, rows, center)
    h *= (chirp.wavelengths_m / (4.0 * np.pi) ** 1.5).astype(np.float32)
    bounds = [points.min(axis=0).tolist(), points.max(axis=0).tolist()]
    return Measurement(h, chirp, aperture, metadata={"targets": [{"name": "points", "bounds_m": bounds}]})


def _point(legs: list[Leg], _place: Any, _normal: Any, weight: Any, _taper: Any) -> tuple[Any, Any, None]:
    """Spreading and path difference of a point scatterer."""
    out, back = legs[0], legs[-1]
    return weight * out.inverse_m * back.inverse_m, 0.5 * (out.excess_m + back.excess_m), None


def _check_ranges(points: Any, chirp: Chirp, aperture: Aperture) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    for antennas in (aperture.tx_m, aperture.receivers_m):
        farthest = max(float(np.linalg.norm(antennas - corner, axis=1).max()) for corner in corners)
        if farthest > chirp.unambiguous_range_m:
            raise RadarError(
                f"a point lies up to {farthest:.2f} m from the radar, beyond the unambiguous range "
                f"{chirp.unambiguous_range_m:.2f} m: its echo would fold back"
            )
        for point in points if len(points) * len(antennas) <= _MAX_PAIRS else ():
            if float(np.linalg.norm(antennas - point, axis=1).min()) < 1e-6:
                raise RadarError(f"the point {point.tolist()} coincides with an antenna")
