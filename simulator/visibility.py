"""Which samples each tile of the aperture sees: wholly, not at all, or in part."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.quadrature import SurfaceSamples, take
from waveformer.simulator.radar import Aperture
from waveformer.simulator.scene import BACK_FACING, BLOCKED, VISIBLE, sample_states
from waveformer.simulator.subapertures import Tile, corner_rows, probe_rows


@dataclass(frozen=True)
class TileVisibility:
    """What one tile sees.

    Attributes:
        lit: samples that all of the tile sees, increasing, shape (L,).
        partial: samples that only some of the tile's ray positions see, increasing, shape (P,).
        partial_visible: 1 or 0 for every ray position and partial sample, shape (L, P).
    """

    lit: NDArray[np.int64]
    partial: NDArray[np.int64]
    partial_visible: NDArray[np.float32]


def _sort(states: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples (columns) that all rows see, where they face at all, and samples the rows disagree on."""
    visible, blocked = (states == VISIBLE).any(axis=0), (states == BLOCKED).any(axis=0)
    return np.flatnonzero(visible & ~blocked), np.flatnonzero(visible & blocked)


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
        self._scene, self._samples, self._two_sided, self._aperture = scene, samples, two_sided, aperture
        self._centers = 0.5 * (aperture.tx_m + aperture.receivers_m)
        self._spacing_m = probe_spacing_m
        self._probes = probe_rows(aperture, probe_spacing_m)
        self._patch, representative = _patches(samples, patch_m)
        receivers = None if aperture.rx_m is None else aperture.rx_m[self._probes]
        # (probes, patches); what changes inside a patch also changes between patches and is traced later
        self._states = sample_states(
            scene,
            samples.points_m[representative],
            samples.normals[representative],
            two_sided,
            aperture.tx_m[self._probes],
            receivers,
        )

    def select(self, index: NDArray[np.int64]) -> VisibilityMap:
        """The map of the samples at `index`, without new rays."""
        selected = copy(self)
        selected._samples = take(self._samples, index)
        selected._patch = self._patch[index]
        return selected

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Samples that some probe sees, or that face away from all of them and may face others, (S,)."""
        seen = (self._states == VISIBLE).any(axis=0) | (self._states != BLOCKED).all(axis=0)
        return np.asarray(seen[self._patch])

    def of_tile(self, tile: Tile) -> TileVisibility:
        """Sort the samples by what the tile sees, with its own rays where the probes disagree."""
        states = self._states[self._near(tile)]
        lit, mixed = (self._samples_of(patches) for patches in _sort(states))
        turned_away = self._samples_of(np.flatnonzero((states == BACK_FACING).all(axis=0)))
        lit = np.concatenate([lit, self._limb(tile, turned_away)])
        # most of what the surroundings disagree on is unanimous inside the tile
        corners = tile.rows[corner_rows(self._centers[tile.rows])]
        receivers = self._aperture.rx_m
        also_lit, mixed_here = _sort(
            self._test_members(
                self._aperture.tx_m[corners], None if receivers is None else receivers[corners], mixed
            )
        )
        lit, mixed = np.concatenate([lit, mixed[also_lit]]), mixed[mixed_here]
        if len(mixed) == 0:
            return TileVisibility(np.sort(lit), mixed, np.empty((len(tile.ray_tx_m), 0), np.float32))
        if tile.ray_shape is None:
            states = self._test_members(tile.ray_tx_m, tile.ray_rx_m, mixed)
        else:
            states = self._trace_lattice(tile, tile.ray_shape, mixed)
        whole = (states != BLOCKED).all(axis=0)
        partial = ~whole & (states == VISIBLE).any(axis=0)
        return TileVisibility(
            np.sort(np.concatenate([lit, mixed[whole]])),
            mixed[partial],
            (states[:, partial] == VISIBLE).astype(np.float32),
        )

    def _trace_lattice(
        self, tile: Tile, shape: tuple[int, ...], members: NDArray[np.int64]
    ) -> NDArray[np.uint8]:
        """States of samples from all ray positions of a tile, (L, P): every second one is traced, and those
        between only in the lattice cells whose corners disagree.
        """
        coarse = np.zeros(shape, dtype=bool)
        coarse[::2, ::2, ::2] = True
        on_coarse = np.flatnonzero(coarse)
        receivers = None if tile.ray_rx_m is None else tile.ray_rx_m[on_coarse]
        # samples of a patch share the rays of the first pass
        _, first, patch = np.unique(self._patch[members], return_index=True, return_inverse=True)
        corners = self._test_members(tile.ray_tx_m[on_coarse], receivers, members[first])[:, patch]
        corners = corners.reshape(*((count + 1) // 2 for count in shape), len(members))
        floor = np.ix_(*(np.arange(count) // 2 for count in shape))
        states, uncertain = corners[floor], np.zeros((*shape, len(members)), dtype=bool)
        low = high = corners == VISIBLE
        axes = [axis for axis in range(3) if shape[axis] > 1]
        for axis in axes:
            ends = [np.arange(low.shape[axis] - 1) + end for end in (0, 1)]
            low, high = (
                combine(array.take(ends[0], axis), array.take(ends[1], axis))
                for combine, array in ((np.logical_and, low), (np.logical_or, high))
            )
        disagree = low != high
        for offset in np.ndindex(*(3 if axis in axes else 1 for axis in range(3))):
            window = tuple(
                slice(o, o + 2 * cells - 1, 2) for o, cells in zip(offset, disagree.shape, strict=False)
            )
            uncertain[window] |= disagree
        uncertain[::2, ::2, ::2] = False
        states[::2, ::2, ::2] = corners
        flat, uncertain = states.reshape(-1, len(members)), uncertain.reshape(-1, len(members))
        pairs = np.nonzero(uncertain)
        points, normals = self._samples.points_m[members], self._samples.normals[members]
        flat[pairs] = sample_states(
            self._scene, points, normals, self._two_sided, tile.ray_tx_m, tile.ray_rx_m, pairs
        )
        return flat

    def _samples_of(self, patches: NDArray[np.int64]) -> NDArray[np.int64]:
        chosen = np.zeros(self._states.shape[1], dtype=bool)
        chosen[patches] = True
        return np.flatnonzero(chosen[self._patch])

    def _limb(self, tile: Tile, members: NDArray[np.int64]) -> NDArray[np.int64]:
        """Of the samples that face away from all near probes, those that an antenna of the tile may face.

        Seen at grazing angles only, and no near probe found anything before them: lit.
        """
        points, normals = self._samples.points_m[members], self._samples.normals[members]
        centers = self._centers[tile.rows]
        reach = np.maximum(normals * centers.min(axis=0), normals * centers.max(axis=0)).sum(axis=1)
        return np.asarray(members[reach > np.einsum("ij,ij->i", normals, points)])

    def _test_members(
        self, tx_m: NDArray[np.float64], rx_m: NDArray[np.float64] | None, members: NDArray[np.int64]
    ) -> NDArray[np.uint8]:
        points, normals = self._samples.points_m[members], self._samples.normals[members]
        return sample_states(self._scene, points, normals, self._two_sided, tx_m, rx_m)

    def _near(self, tile: Tile) -> NDArray[np.int64]:
        """Probes inside the tile's bounding box grown by one spacing, at least the nearest one."""
        group = self._centers[tile.rows]
        probes = self._centers[self._probes]
        outside = np.maximum(group.min(axis=0) - probes, probes - group.max(axis=0)).max(axis=1)
        return np.flatnonzero(outside <= max(0.75 * self._spacing_m, float(outside.min())))
