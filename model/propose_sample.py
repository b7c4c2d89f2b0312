"""One sample of a proposed dataset: the candidate surfaces of a signal, their losses, and which is nearest to the truth."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_layout import ArrayInfo
from waveformer.datagen.dataset_reader import Dataset, open_dataset
from waveformer.datagen.dataset_store import read_layout
from waveformer.datagen.farthest_points import farthest_points
from waveformer.datagen.partial_cloud import fixed_size
from waveformer.datagen.twin_scene import CROP_MARGIN_M
from waveformer.model.imaging_volume import Volume
from waveformer.model.proposal import Proposal, propose_surfaces
from waveformer.model.propose_settings import ProposeSettings
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.measurement import Measurement

MAKER = f"{__name__}:make_sample"
SOURCE_FILE = "source.txt"
INDICES_FILE = "indices.txt"
# So many first points of a candidate are its farthest ones: an even cloud of it, and enough to judge it by.
_FARTHEST = 256
COPIED = ("truth_m", "truth_normals", "pose")
Arrays = dict[str, NDArray[Any]]


class _Plan(NamedTuple):
    settings: ProposeSettings
    source: Dataset
    indices: NDArray[np.int64]


def arrays_of(settings: ProposeSettings, source: Dataset) -> tuple[ArrayInfo, ...]:
    """The arrays of every sample; candidates beyond the last are NaN, their counts 0."""
    count, candidate = settings.candidates, ("candidate",)
    return (
        *(source.arrays[name] for name in COPIED),
        ArrayInfo(
            "candidate_m",
            (count, settings.points, 3),
            "float32",
            (*candidate, "candidate_point", "axis"),
            "m",
        ),
        ArrayInfo("candidate_count", (count,), "int32", candidate),
        ArrayInfo("candidate_loss", (count,), "float32", candidate),
        ArrayInfo("candidate_level_m", (count,), "float32", candidate, "m"),
        ArrayInfo("candidate_error_m", (count,), "float32", candidate, "m"),
        ArrayInfo("chosen", (), "int32", ()),
        ArrayInfo("best", (), "int32", ()),
    )


def make_sample(root: str, index: int) -> tuple[Arrays, dict[str, Any]]:
    """The candidates of one signal.

    Candidate i is the field's level with the i-th least loss, so the chosen one is nearly always the first; components
    other than the largest stay at their choice. Its error is the median distance of its first points
    to the truth.

    Args:
        root: of the proposed dataset.
        index: of the sample.

    Raises:
        RadarError: the signal shows no surface, or cannot be imaged.
        StoreError: the signal's dataset is damaged or has moved.
    """
    settings, source, indices = _plan(root)
    number = int(indices[index])
    given, known = source.read(number, [*COPIED, "h"]), source.record(number)
    chirp, aperture = source.chirp, source.aperture
    assert chirp is not None and aperture is not None, "checked before the run"
    measurement = Measurement(given["h"], chirp, aperture, known["signal"]["range_bias_m"], {})
    crop = None
    if settings.crop == "bounds":
        low, high = np.asarray(known["bounds_m"])
        crop = Volume(low - CROP_MARGIN_M, high + CROP_MARGIN_M)
    rng = generator(settings.seed, f"proposal of {known['object_id']}", known["view"])
    proposal = propose_surfaces(measurement, settings.proposal, crop=crop, rng=rng)
    if proposal.selection is None or proposal.selection.is_empty:
        raise RadarError(f"sample {number} of {source.root.name} shows no surface: {proposal.reason}")
    arrays: Arrays = {name: given[name] for name in COPIED}
    arrays.update(_candidates(proposal, given["truth_m"].astype(np.float64), settings))
    record = {
        **{name: known[name] for name in ("object_id", "category", "split", "licence", "view")},
        "source_index": number,
        "num_levels": len(proposal.levels_m[_main(proposal)]),
        "num_components": len(proposal.fields),
        "chosen_m": list(proposal.chosen_m),
        "column_ratio": proposal.column_ratio(),
        "uncertain": proposal.uncertain,
        "confidence": proposal.confidence(measurement),
        "warnings": list(proposal.warnings),
    }
    return arrays, record


def _candidates(proposal: Proposal, truth_m: NDArray[np.float64], settings: ProposeSettings) -> Arrays:
    from scipy.spatial import KDTree

    selection, main = proposal.selection, _main(proposal)
    assert selection is not None, "checked before"
    loss, levels_m = selection.antenna_losses[main].mean(axis=1), proposal.levels_m[main]
    others = [
        stack.points_at(level)
        for i, (stack, level) in enumerate(zip(proposal.stacks, selection.level_index, strict=True))
        if i != main and level >= 0
    ]
    tree, count = KDTree(truth_m), settings.candidates
    found: Arrays = {
        "candidate_m": np.full((count, settings.points, 3), np.nan, dtype=np.float32),
        "candidate_count": np.zeros(count, dtype=np.int32),
        **{
            name: np.full(count, np.nan, dtype=np.float32)
            for name in ("candidate_loss", "candidate_level_m", "candidate_error_m")
        },
        "chosen": np.array(-1, dtype=np.int32),
    }
    order = np.argsort(loss, kind="stable")[:count]
    for place, level in enumerate(order):
        points = np.concatenate([proposal.stacks[main].points_at(level), *others])
        if len(points) == 0:
            continue
        cloud = fixed_size(_spread(points, settings.points), settings.points)
        found["candidate_m"][place], found["candidate_count"][place] = cloud
        found["candidate_loss"][place] = loss[level]
        found["candidate_level_m"][place] = levels_m[level]
        judged = cloud.points_m[: min(cloud.num_valid, _FARTHEST)]
        found["candidate_error_m"][place] = np.median(tree.query(judged)[0])
        if level == selection.level_index[main]:
            found["chosen"] = np.array(place, dtype=np.int32)
    error = found["candidate_error_m"]
    found["best"] = np.array(-1 if np.isnan(error).all() else np.nanargmin(error), dtype=np.int32)
    return found


def _spread(points_m: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """At most `count` points, the farthest ones first, then others from everywhere: levels come column by column."""
    points_m = points_m[np.linspace(0, len(points_m) - 1, min(count, len(points_m))).astype(np.int64)]
    first = farthest_points(points_m, _FARTHEST)
    return np.concatenate([points_m[first], np.delete(points_m, first, axis=0)])


def _main(proposal: Proposal) -> int:
    """The largest component that has a level."""
    assert proposal.selection is not None, "checked before"
    return next(i for i, level in enumerate(proposal.selection.level_index) if level >= 0)


@lru_cache(maxsize=2)
def _plan(root: str) -> _Plan:
    folder = Path(root)
    settings = ProposeSettings.model_validate(read_layout(folder).settings)
    source = open_dataset((folder / SOURCE_FILE).read_text(encoding="utf-8").strip())
    return _Plan(settings, source, np.loadtxt(folder / INDICES_FILE, dtype=np.int64, ndmin=1))
