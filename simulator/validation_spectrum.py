"""Truth for extended bodies behind a sheet: the plane-wave spectrum on each way, integrated over the body."""

from __future__ import annotations

import numpy as np

from waveformer.simulator.interpolation import chebyshev_points, lagrange_weights
from waveformer.simulator.occluders import Sheet
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture
from waveformer.simulator.sheet_spectrum import spectrum_transmission
from waveformer.simulator.validation_result import ComplexArray, FloatArray

# For a plate of 4 cm seen at 25 degrees, 60 radians of phase from side to side; more nodes change it by 2e-8
_PLATE_NODES = 28
_LATERAL_NODES, _HEIGHT_NODES = 14, 6
# A level sheet has all heights equal
_MARGIN_M = 1e-6


def plate_behind_sheet(
    side_m: float, depth_m: float, sheet: Sheet, aperture: Aperture, frequencies_hz: FloatArray
) -> ComplexArray:
    """Conducting square plate, level and centred under the origin, behind a sheet: physical optics.

    Args:
        side_m: side of the plate.
        depth_m: its z, negative.
        sheet: between all antennas and the plate.
        aperture: N pairs, E along y.
        frequencies_hz: shape (F,).

    Returns:
        h, shape (N, F).
    """
    unit, weight = np.polynomial.legendre.leggauss(_PLATE_NODES)
    x, y = (axis.ravel() for axis in np.meshgrid(side_m / 2 * unit, side_m / 2 * unit, indexing="ij"))
    points = np.column_stack([x, y, np.full_like(x, depth_m)])
    area = np.outer(weight, weight).ravel() * (side_m / 2) ** 2
    tx, rx = (_Ways(antennas, points, sheet) for antennas in (aperture.tx_m, aperture.receivers_m))
    spans = [
        (min(one.min(), other.min()) - _MARGIN_M, max(one.max(), other.max()) + _MARGIN_M)
        for one, other in ((tx.lateral, rx.lateral), (tx.height, rx.height))
    ]
    tx_at, rx_at = tx.between_nodes(spans), rx.between_nodes(spans)
    amplitude = area * (tx.cosine + rx.cosine) / 2 / (tx.distance * rx.distance)
    h = np.empty((len(aperture), len(frequencies_hz)), dtype=complex)
    for column, frequency in enumerate(frequencies_hz):
        table = _transmission_table(sheet, spans, float(frequency))
        product = (tx.behind(table, tx_at) * rx.behind(table, rx_at)).sum(axis=-1) / (
            tx.field * rx.field
        ).sum(axis=-1)
        k = 2 * np.pi * frequency / SPEED_OF_LIGHT_M_PER_S
        wave = np.exp(-1j * k * (tx.distance + rx.distance))
        h[:, column] = -1j / (4 * np.pi) * (amplitude * product * wave).sum(axis=-1)
    return h


class _Ways:
    """Straight ways between antennas (N, 3) and points (P, 3): all arrays (N, P) or (N, P, 3)."""

    def __init__(self, antennas_m: FloatArray, points_m: FloatArray, sheet: Sheet) -> None:
        way = antennas_m[:, None] - points_m
        normal = np.asarray(sheet.normal)
        self.distance = np.linalg.norm(way, axis=-1)
        direction = way / self.distance[..., None]
        self.cosine = direction[..., 2]
        self.height = np.abs(way @ normal)
        self.lateral = np.sqrt(np.maximum(self.distance**2 - self.height**2, 0.0))
        field = np.array([0.0, 1.0, 0.0]) - direction[..., 1:2] * direction
        self.field = field / np.linalg.norm(field, axis=-1, keepdims=True)
        across = np.cross(direction, normal)
        self._across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-12)

    def between_nodes(self, spans: list[tuple[float, float]]) -> list[FloatArray]:
        """Weights of the entries of a table in lateral distance and in height, each (N * P, entries)."""
        return [
            lagrange_weights(chebyshev_points(count), 2 * (values.ravel() - low) / (high - low) - 1)
            for count, values, (low, high) in zip(
                (_LATERAL_NODES, _HEIGHT_NODES), (self.lateral, self.height), spans, strict=True
            )
        ]

    def behind(self, table: ComplexArray, weights: list[FloatArray]) -> ComplexArray:
        """The unit field after the sheet, (N, P, 3)."""
        waves = [(weights[0] @ wave * weights[1]).sum(axis=1) for wave in table]
        s, p = (wave.reshape(self.distance.shape) for wave in waves)
        share = (self.field * self._across).sum(axis=-1, keepdims=True) * self._across
        return np.asarray(p[..., None] * self.field + (s - p)[..., None] * share)


def _transmission_table(sheet: Sheet, spans: list[tuple[float, float]], frequency_hz: float) -> ComplexArray:
    """Transmission of s and p waves on Chebyshev points of both spans, (2, lateral, height)."""
    assert sheet.material.permittivity is not None
    eps = sheet.material.permittivity.at(frequency_hz)
    lateral, height = (
        low + (high - low) * (chebyshev_points(count) + 1) / 2
        for count, (low, high) in zip((_LATERAL_NODES, _HEIGHT_NODES), spans, strict=True)
    )
    values = [
        [spectrum_transmission(eps, sheet.thickness_m, r, z, frequency_hz) for z in height] for r in lateral
    ]
    return np.moveaxis(np.array(values)[..., 0], -1, 0)
