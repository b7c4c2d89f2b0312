"""Farthest-point sampling: thin a cloud to points that cover it evenly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

_BUCKET_POINTS = 64


def farthest_points(points_m: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Rows of a subset in which each next point is the farthest from all before it.

    The first is the point farthest from the centroid, so there is no chance in the choice; of equally far
    points one is taken by a fixed rule. Buckets of a KD-tree that the new point cannot come nearer to are
    left out, which changes no distance (Han et al. 2023, "QuickFPS").

    Args:
        points_m: (P, 3), finite.
        count: at most this many; all points, in their order, if there are no more.

    Returns:
        Shape (min(P, count),), in the order of choice.
    """
    total = len(points_m)
    if total <= count:
        return np.arange(total)
    rows = _buckets(points_m)
    # A short last bucket repeats one of its points: a copy lies at distance zero as soon as it is chosen.
    members = np.moveaxis(points_m[rows], 2, 0).copy()  # (3, buckets, members)
    low, high = members.min(axis=2), members.max(axis=2)
    squared = np.full(rows.shape, np.inf)
    farthest = np.full(len(rows), np.inf)
    position = np.zeros(len(rows), dtype=np.int64)

    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = np.argmax(((points_m - points_m.mean(axis=0)) ** 2).sum(axis=1))
    for turn in range(1, count):
        new = points_m[chosen[turn - 1]][:, None]
        to_box = np.clip(new, low, high) - new
        near = np.flatnonzero(np.einsum("ib,ib->b", to_box, to_box) < farthest)
        offset = members[:, near] - new[:, :, None]
        updated = np.minimum(squared[near], np.einsum("ibm,ibm->bm", offset, offset))
        squared[near] = updated
        position[near] = updated.argmax(axis=1)
        farthest[near] = updated[np.arange(len(near)), position[near]]
        bucket = farthest.argmax()
        chosen[turn] = rows[bucket, position[bucket]]
    return chosen


def _buckets(points_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Neighbouring points row by row, (buckets, `_BUCKET_POINTS`), the last filled up with a repeated point."""
    order = np.asarray(KDTree(points_m, leafsize=_BUCKET_POINTS // 2).indices, dtype=np.int64)
    missing = -len(order) % _BUCKET_POINTS
    return np.concatenate([order, np.repeat(order[-1:], missing)]).reshape(-1, _BUCKET_POINTS)
