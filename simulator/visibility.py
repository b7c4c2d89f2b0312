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


class VisibilityMap:
    """Visibility of one target's samples over the aperture, probed coarsely and refined on demand.

    Args:
        scene: Mitsuba scene of all targets (mutual shadowing).
        samples: S samples of the target in the radar frame.
        two_sided: see `SurfaceMesh`.
        aperture: N pairs.
        probe_spacing_m: extent of a sub-aperture of the first pass.
    """

    def __init__(
        self, scene: Any, samples: SurfaceSamples, two_sided: bool, aperture: Aperture, probe_spacing_m: float
    ) -> None:
        self._scene, self._samples, self._two_sided, self._aperture = scene, samples, two_sided, aperture
        self._centers = 0.5 * (aperture.tx_m + aperture.receivers_m)
        self._spacing_m = probe_spacing_m
        self._probes = probe_rows(aperture, probe_spacing_m)
        receivers = None if aperture.rx_m is None else aperture.rx_m[self._probes]
        self._states = self._test(aperture.tx_m[self._probes], receivers)

    def select(self, index: NDArray[np.int64]) -> VisibilityMap:
        """The map of the samples at `index`, without new rays."""
        selected = copy(self)
        selected._samples = take(self._samples, index)
        selected._states = self._states[:, index]
        return selected

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Samples that some probe sees, or that face away from all of them and may face others, (S,)."""
        return np.asarray((self._states == VISIBLE).any(axis=0) | (self._states != BLOCKED).all(axis=0))

    def of_tile(self, tile: Tile) -> TileVisibility:
        """Sort the samples by what the tile sees, with its own rays where the probes disagree."""
        states = self._states[self._near(tile)]
        lit, mixed = _sort(states)
        lit = np.concatenate([lit, self._limb(tile, np.flatnonzero((states == BACK_FACING).all(axis=0)))])
        # most of what the surroundings disagree on is unanimous inside the tile
        corners = tile.rows[corner_rows(self._centers[tile.rows])]
        receivers = self._aperture.rx_m
        also_lit, mixed_here = _sort(
            self._test_members(
                self._aperture.tx_m[corners], None if receivers is None else receivers[corners], mixed
            )
        )
        lit, mixed = np.concatenate([lit, mixed[also_lit]]), mixed[mixed_here]
        states = self._test_members(tile.ray_tx_m, tile.ray_rx_m, mixed)
        whole = (states != BLOCKED).all(axis=0)
        partial = ~whole & (states == VISIBLE).any(axis=0)
        return TileVisibility(
            np.sort(np.concatenate([lit, mixed[whole]])),
            mixed[partial],
            (states[:, partial] == VISIBLE).astype(np.float32),
        )

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
        sample_row, position_row = np.tile(members, len(tx_m)), np.repeat(np.arange(len(tx_m)), len(members))
        return self._test(tx_m, rx_m, sample_row, position_row).reshape(len(tx_m), len(members))

    def _near(self, tile: Tile) -> NDArray[np.int64]:
        """Probes inside the tile's bounding box grown by one spacing, at least the nearest one."""
        group = self._centers[tile.rows]
        probes = self._centers[self._probes]
        outside = np.maximum(group.min(axis=0) - probes, probes - group.max(axis=0)).max(axis=1)
        return np.flatnonzero(outside <= max(0.75 * self._spacing_m, float(outside.min())))

    def _test(
        self,
        tx_m: NDArray[np.float64],
        rx_m: NDArray[np.float64] | None,
        sample_row: NDArray[np.int64] | None = None,
        position_row: NDArray[np.int64] | None = None,
    ) -> NDArray[np.uint8]:
        points, normals = self._samples.points_m, self._samples.normals
        return sample_states(
            self._scene, points, normals, self._two_sided, tx_m, rx_m, sample_row, position_row
        )
