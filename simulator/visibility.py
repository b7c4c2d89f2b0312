"""Which samples each tile of the aperture sees: wholly, not at all, or in part."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import Aperture
from waveformer.simulator.scene import BLOCKED, VISIBLE, SampleTable, sample_states
from waveformer.simulator.subapertures import Tile, corner_rows, probe_rows

# The echo of a shadow's edge grows with the cosine on the surface that it falls on: below this one its place
# is interpolated between every second ray position of a tile instead of traced at all.
GRAZING_COSINE = 0.25


@dataclass(frozen=True)
class TileVisibility:
    """What one tile sees.

    Attributes:
        lit: samples that all of the tile sees, increasing, shape (L,).
        partial: samples that only some of the tile's ray positions see, increasing, shape (P,).
        partial_visible: 0 .. 1 for every ray position and partial sample, shape (L, P). Multiples of an eighth,
            which half precision holds exactly: it is what a frozen scene has most of.
    """

    lit: NDArray[np.int64]
    partial: NDArray[np.int64]
    partial_visible: NDArray[np.float16]

    def divide(self, chosen: NDArray[np.bool_]) -> tuple[TileVisibility, TileVisibility]:
        """Two parts: the lit samples with the partial ones that are not chosen, and the chosen partial ones; (P,)."""
        nobody = np.empty(0, dtype=np.int64)
        return (
            TileVisibility(self.lit, self.partial[~chosen], self.partial_visible[:, ~chosen]),
            TileVisibility(nobody, self.partial[chosen], self.partial_visible[:, chosen]),
        )


def _patches(samples: SurfaceSamples, extent_m: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Patch of every sample (S,), and one sample for every patch: neighbours that face the same way."""
    place = np.floor((samples.points_m - samples.points_m.min(axis=0)) / extent_m)
    facing = np.round(2.0 * samples.normals) + 2.0  # five steps an axis: within about 30 degrees
    sizes = np.concatenate([place.max(axis=0) + 1, [5, 5, 5]]).astype(np.int64)
    key = np.ravel_multi_index(
        tuple(np.concatenate([place, facing], axis=1).T.astype(np.int64)), tuple(sizes)
    )
    _, first, patch = np.unique(key, return_index=True, return_inverse=True)
    return patch, first


class VisibilityMap:
    """Visibility of one target's samples over the aperture, probed coarsely and refined on demand.

    Args:
        scene: Mitsuba scene of all targets (mutual shadowing).
        samples: S samples of the target in the radar frame.
        two_sided: see `SurfaceMesh`.
        aperture: N pairs.
        probe_spacing_m: extent of a sub-aperture of the first pass.
        patch_m: extent of a patch of samples that share one ray of the first pass.
    """

    def __init__(
        self,
        scene: Any,
        samples: SurfaceSamples,
        two_sided: bool,
        aperture: Aperture,
        probe_spacing_m: float,
        patch_m: float,
    ) -> None:
        self._scene, self._two_sided, self._aperture = scene, two_sided, aperture
        self._spacing_m = probe_spacing_m
        self._centers = 0.5 * (aperture.tx_m + aperture.receivers_m)
        self._probes = probe_rows(aperture, probe_spacing_m)
        self._patch, representative = _patches(samples, patch_m)
        self._hold(samples)
        receivers = None if aperture.rx_m is None else aperture.rx_m[self._probes]
        # (probes, patches); what changes inside a patch also changes between patches and is traced later
        states = self._trace(aperture.tx_m[self._probes], receivers, representative)
        # a bit a probe, (probes / 8, patches)
        self._visible, self._blocked = (np.packbits(states == kind, axis=0) for kind in (VISIBLE, BLOCKED))

    def _hold(self, samples: SurfaceSamples) -> None:
        self._samples, self._table = samples, SampleTable(samples.points_m, samples.normals)

    def select(self, index: NDArray[np.int64]) -> VisibilityMap:
        """The map of the samples at `index`, without new rays."""
        selected = copy(self)
        selected._hold(take(self._samples, index))
        selected._patch = self._patch[index]
        return selected

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Samples that some probe sees, or that face away from all of them and may face others, (S,)."""
        seen = np.asarray(self._visible.any(axis=0) | ~self._blocked.any(axis=0))
        return seen.take(self._patch)

    def of_tile(self, tile: Tile) -> TileVisibility:
        """Sort the samples by what the tile sees, with its own rays where the probes disagree."""
        lit, mixed, turned_away = self._by_near_probes(tile)
        lit = np.concatenate([lit, self._limb(tile, turned_away)])
        # most of what the surroundings disagree on is unanimous inside the tile
        corners = tile.rows[corner_rows(self._centers[tile.rows])]
        receivers = None if self._aperture.rx_m is None else self._aperture.rx_m[corners]
        states = self._trace(self._aperture.tx_m[corners], receivers, mixed)
        visible, blocked = (states == VISIBLE).any(axis=0), (states == BLOCKED).any(axis=0)
        lit, mixed = np.concatenate([lit, mixed[visible & ~blocked]]), mixed[visible & blocked]
        if len(mixed) == 0:
            return TileVisibility(np.sort(lit), mixed, np.empty((len(tile.ray_tx_m), 0), np.float16))
        if tile.ray_shape is None:
            states = self._trace(tile.ray_tx_m, tile.ray_rx_m, mixed)
            share = (states == VISIBLE).astype(np.float32)
            whole = (states != BLOCKED).all(axis=0)
        else:
            share, whole = self._trace_lattice(tile, tile.ray_shape, mixed)
        partial = ~whole & share.any(axis=0)
        lit = np.sort(np.concatenate([lit, mixed[whole]]))
        return TileVisibility(lit, mixed[partial], share[:, partial].astype(np.float16))

    def _by_near_probes(self, tile: Tile) -> tuple[NDArray[np.int64], ...]:
        """Samples that all near probes see, where they face them; that some see; that none faces."""
        near = np.zeros(len(self._probes), dtype=bool)
        near[self._near(tile)] = True
        near_bits = np.packbits(near)
        used = np.flatnonzero(near_bits)
        visible, blocked = (
            (bits[used] & near_bits[used, None]).any(axis=0) for bits in (self._visible, self._blocked)
        )
        kind = np.asarray(2 * visible + blocked).astype(np.uint8).take(self._patch)
        return np.flatnonzero(kind == 2), np.flatnonzero(kind == 3), np.flatnonzero(kind == 0)

    def _trace_lattice(
        self, tile: Tile, shape: tuple[int, ...], members: NDArray[np.int64]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Visibility of samples from all ray positions of a tile, (L, P) in 0 .. 1, and whether none is blocked.

        Every second position is traced, and those between only in the lattice cells whose corners disagree
        and for samples that do not graze; the others are interpolated.
        """
        coarse = np.zeros(shape, dtype=bool)
        coarse[::2, ::2, ::2] = True
        on_coarse = np.flatnonzero(coarse)
        receivers = None if tile.ray_rx_m is None else tile.ray_rx_m[on_coarse]
        # samples of a patch share the rays of the first pass
        _, first, patch = np.unique(self._patch[members], return_index=True, return_inverse=True)
        states = self._trace(tile.ray_tx_m[on_coarse], receivers, members[first])
        corners = (states == VISIBLE).reshape(*((count + 1) // 2 for count in shape), -1)
        share = corners.astype(np.float32)
        for axis in range(3):
            share = _midpoints(share, axis)
        between = ((share > 0) & (share < 1)).reshape(len(tile.ray_tx_m), -1)
        share = share.reshape(between.shape)[:, patch]
        blocked = (states == BLOCKED).any(axis=0)[patch]
        columns, rows = np.nonzero(between.T[patch] & (self._cosine(tile, members) > GRAZING_COSINE)[:, None])
        traced = sample_states(
            self._scene,
            self._table,
            self._two_sided,
            tile.ray_tx_m,
            tile.ray_rx_m,
            members=members,
            pairs=(rows, columns),
        )
        share[rows, columns] = traced == VISIBLE
        blocked[columns[traced == BLOCKED]] = True
        return share, ~blocked

    def _cosine(self, tile: Tile, members: NDArray[np.int64]) -> NDArray[np.float64]:
        """Cosine between the normals of samples and their direction to the middle of a tile, sides apart."""
        towards = self._centers[tile.rows].mean(axis=0) - self._samples.points_m[members]
        projected = np.einsum("ij,ij->i", self._samples.normals[members], towards)
        return np.asarray(np.abs(projected) / np.linalg.norm(towards, axis=1))

    def _limb(self, tile: Tile, members: NDArray[np.int64]) -> NDArray[np.int64]:
        """Of the samples that face away from all near probes, those that an antenna of the tile may face.

        Seen at grazing angles only, and no near probe found anything before them: lit.
        """
        points, normals = self._samples.points_m[members], self._samples.normals[members]
        centers = self._centers[tile.rows]
        reach = np.maximum(normals * centers.min(axis=0), normals * centers.max(axis=0)).sum(axis=1)
        return np.asarray(members[reach > np.einsum("ij,ij->i", normals, points)])

    def _trace(
        self, tx_m: NDArray[np.float64], rx_m: NDArray[np.float64] | None, members: NDArray[np.int64]
    ) -> NDArray[np.uint8]:
        """States of samples from all given positions, (P, M)."""
        return sample_states(self._scene, self._table, self._two_sided, tx_m, rx_m, members=members)

    def _near(self, tile: Tile) -> NDArray[np.int64]:
        """Probes inside the tile's bounding box grown by one spacing, at least the nearest one."""
        group = self._centers[tile.rows]
        probes = self._centers[self._probes]
        outside = np.maximum(group.min(axis=0) - probes, probes - group.max(axis=0)).max(axis=1)
        return np.flatnonzero(outside <= max(0.75 * self._spacing_m, float(outside.min())))


def _midpoints(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """The values with the mean of every two neighbours along an axis between them."""
    low, high = (
        values.take(range(values.shape[axis] - 1), axis),
        values.take(range(1, values.shape[axis]), axis),
    )
    shape = list(values.shape)
    shape[axis] = 2 * shape[axis] - 1
    filled = np.empty(shape, dtype=values.dtype)
    at: list[slice] = [slice(None)] * values.ndim
    for offset, part in ((0, values), (1, 0.5 * (low + high))):
        at[axis] = slice(offset, None, 2)
        filled[tuple(at)] = part
    return filled
