"""Farthest-point sampling: thin a cloud to points that cover it evenly."""

from __future__ import annotations

from heapq import heapify, heappop, heappush

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

# The first points concern nearly the whole cloud and are chosen one by one, and so many inside a crowd.
_SINGLE_POINTS = 128
# A round chooses all points farther than this share of the farthest; smaller shares mean fewer, longer rounds.
_ROUND_SHARE = 0.85
# From this share of the cloud on the rest has few neighbours each and is one round.
_LAST_ROUND = 0.4
# A crowd far from all chosen points has too many pairs to list; a few choices inside bring all of it near.
_LISTED_POINTS, _PAIRS_PER_POINT = 3000, 400


def farthest_points(points_m: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """Rows of a subset in which each next point is the farthest from all before it.

    The first is the point farthest from the centroid, so there is no chance in the choice; of equally far
    points one is taken by a fixed rule. The first n of the rows are the subset of n points.

    Works in rounds: points nearer than a share of the largest distance cannot be next as long as farther ones
    are left, so a round chooses among those few alone, exactly, and the others hear of all its choices at once.

    Args:
        points_m: (P, 3), finite.
        count: at most this many; all points, in their order, if there are no more.

    Returns:
        Shape (min(P, count),), in the order of choice.
    """
    return np.arange(len(points_m)) if len(points_m) <= count else _ordered(points_m, count)


def farthest_order(points_m: NDArray[np.float64], count: int | None = None) -> NDArray[np.int64]:
    """Rows in the order in which `farthest_points` chooses them, all or the first `count`, also if there are no more."""
    count = len(points_m) if count is None else min(count, len(points_m))
    return _ordered(points_m, count) if count else np.arange(0)


def _ordered(points_m: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = np.argmax(((points_m - points_m.mean(axis=0)) ** 2).sum(axis=1))
    distance_m = np.full(len(points_m), np.inf)
    across = np.ascontiguousarray(points_m.T)
    tree = KDTree(points_m)
    farthest_m = np.inf
    done, single_until = 0, _SINGLE_POINTS
    new = chosen[:1]
    while True:
        done += len(new)
        if done == count:
            return chosen
        if len(new) == 1:
            offset = across - across[:, new]
            np.minimum(distance_m, np.sqrt(np.einsum("ip,ip->p", offset, offset)), out=distance_m)
        else:
            near = KDTree(points_m[new]).sparse_distance_matrix(tree, farthest_m, output_type="ndarray")
            np.minimum.at(distance_m, near["j"], near["v"])
        new = np.array([distance_m.argmax()])
        farthest_m = float(distance_m[new[0]])
        if farthest_m == 0.0:  # copies of chosen points are all that is left
            chosen[done:] = np.delete(np.arange(len(points_m)), chosen[:done])[: count - done]
            return chosen
        if done >= single_until:
            limit_m = _ROUND_SHARE * farthest_m if done < _LAST_ROUND * len(points_m) else 0.0
            far = np.flatnonzero((distance_m >= limit_m) & (distance_m > 0))
            far_tree = KDTree(points_m[far])
            if _is_crowd(far_tree, farthest_m):
                single_until = done + _SINGLE_POINTS
            else:
                new = far[_choose(points_m[far], distance_m[far], far_tree, limit_m)][: count - done]
        chosen[done : done + len(new)] = new


def _is_crowd(tree: KDTree, reach_m: float) -> bool:
    if tree.n <= _LISTED_POINTS:
        return False
    return int(tree.count_neighbors(tree, reach_m)) > _PAIRS_PER_POINT * int(tree.n)


def _choose(
    points_m: NDArray[np.float64], distance_m: NDArray[np.float64], tree: KDTree, limit_m: float
) -> list[int]:
    """Rows in the order of choice until no point is farther than the limit."""
    neighbours, away_m, start = _neighbours(points_m, distance_m, tree)
    now_m = distance_m.tolist()
    queue = [(-far_m, row) for row, far_m in enumerate(now_m)]
    heapify(queue)
    chosen = []
    while queue:
        far_m, row = heappop(queue)
        if -far_m != now_m[row]:
            continue  # it has come nearer since
        chosen.append(row)
        now_m[row] = 0.0
        for place in range(start[row], start[row + 1]):
            other = neighbours[place]
            if away_m[place] < now_m[other]:
                now_m[other] = away_m[place]
                if away_m[place] >= limit_m:
                    heappush(queue, (-away_m[place], other))
    return chosen


def _neighbours(
    points_m: NDArray[np.float64], distance_m: NDArray[np.float64], tree: KDTree
) -> tuple[list[int], list[float], list[int]]:
    """Of every point those that it would bring nearer: their rows, how far they are, where each list begins."""
    pairs = tree.query_pairs(float(distance_m.max()), output_type="ndarray")
    away_m = np.linalg.norm(points_m[pairs[:, 0]] - points_m[pairs[:, 1]], axis=1)
    source, target = np.concatenate([pairs, pairs[:, ::-1]]).T
    away_m = np.tile(away_m, 2)
    nearer = np.flatnonzero(away_m < distance_m[target])
    order = nearer[np.argsort(source[nearer], kind="stable")]
    start = np.searchsorted(source[order], np.arange(len(points_m) + 1))
    return target[order].tolist(), away_m[order].tolist(), start.tolist()
