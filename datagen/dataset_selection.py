"""Which samples of a dataset are wanted: by split, object, category, size of their partials."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_reader import Dataset
from waveformer.simulator.errors import StoreError

_MOST_NAMED = 8


def select_samples(
    data: Dataset,
    *,
    splits: Collection[str] | None = None,
    object_ids: Collection[str] | None = None,
    categories: Collection[str] | None = None,
    least_partial_points: int = 0,
    limit: int | None = None,
) -> NDArray[np.int64]:
    """Committed samples that fulfil every condition.

    Args:
        data: an open dataset.
        splits: wanted; None means all.
        object_ids: wanted; None means all.
        categories: wanted; None means all.
        least_partial_points: that Eq. 2-3 kept in each partial; a radar may see nothing of an object.
        limit: the first so many of them; None means all.

    Returns:
        Indices, ascending.

    Raises:
        StoreError: no sample is left, or none has a value that was asked for.
    """
    chosen = data.indices
    if splits is not None or object_ids is not None or categories is not None:
        wanted = {"split": splits, "object_id": object_ids, "category": categories}
        conditions = {key: set(values) for key, values in wanted.items() if values is not None}
        found: dict[str, set[str]] = {key: set() for key in conditions}
        kept = []
        for index in chosen:
            record = data.record(index)
            for key in conditions:
                found[key].add(record.get(key, ""))
            if all(record.get(key, "") in values for key, values in conditions.items()):
                kept.append(index)
        for key, values in conditions.items():
            if unknown := sorted(values - found[key]):
                raise StoreError(f"{data.root} has no sample with {key} {unknown[0]!r}: {_named(found[key])}")
        chosen = np.array(kept, dtype=np.int64)
    if least_partial_points > 0:
        large = [_least_kept(data.record(index)) >= least_partial_points for index in chosen]
        chosen = chosen[np.array(large, dtype=bool)]
    if limit is not None and limit < 1:
        raise StoreError(f"limit must be at least 1, got {limit}")
    chosen = chosen[:limit]
    if not len(chosen):
        raise StoreError(f"{data.root} has no committed sample of this choice")
    return chosen


def known_names(data: Dataset, names: Collection[str] | None) -> tuple[str, ...]:
    """The arrays asked for, each once; None means all.

    Raises:
        StoreError: the dataset has no such array, or none was asked for.
    """
    if names is None:
        return tuple(data.arrays)
    if unknown := [name for name in names if name not in data.arrays]:
        raise StoreError(f"{data.root} has no array {unknown[0]!r}; it has {', '.join(data.arrays)}")
    if not names:
        raise StoreError(f"name at least one array: {data.root} has {', '.join(data.arrays)}")
    return tuple(dict.fromkeys(names))


def _least_kept(record: Mapping[str, Any]) -> int:
    return min((partial["kept_points"] for partial in record.get("partials", ())), default=0)


def _named(values: set[str]) -> str:
    first = ", ".join(sorted(values)[:_MOST_NAMED])
    more = len(values) - _MOST_NAMED
    return f"it has {first or 'none'}" + (f" and {more} more" if more > 0 else "")
