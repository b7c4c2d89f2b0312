"""The table of methods and conditions: means over objects with intervals, beside the paper's rows."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np

from waveformer.eval.bootstrap import Estimate, MeanKind, bootstrap_mean
from waveformer.eval.classes import COVERAGE_CLASSES, SIZE_CLASSES, class_means, mean_of_class_means
from waveformer.eval.metrics import ReconstructionScore
from waveformer.eval.paper_rows import PAPER_ROWS, PaperRow
from waveformer.simulator.errors import RadarError

MEAN_KINDS: dict[MeanKind, str] = {
    "size_classes": "mean of size-class means",
    "objects": "mean over objects",
}
_Number = TypeVar("_Number", int, float)


@dataclass(frozen=True)
class ScoredCloud:
    """One cloud of one object.

    Attributes:
        method, condition, alignment: what the rows of the table are sorted by.
        object_name: for the list of objects.
        size_class: of `SIZE_CLASSES`.
        coverage_class: of `COVERAGE_CLASSES`; None if there is no partial cloud to take it from.
        score: of the cloud.
    """

    method: str
    condition: str
    alignment: str
    object_name: str
    size_class: str
    coverage_class: str | None
    score: ReconstructionScore


@dataclass(frozen=True)
class TableRow:
    """Means over the objects of one method, condition and alignment.

    Attributes:
        mean_kind: how objects are weighted in the estimates.
        num_objects: how many there are.
        chamfer, f_score, precision, recall: estimates with 95 % intervals.
        chamfer_by_size, chamfer_by_coverage: mean over the objects of every class that occurs.
        objects_by_size, objects_by_coverage: their numbers.
        f_by_threshold: same kind of mean of F at other thresholds.
    """

    method: str
    condition: str
    alignment: str
    mean_kind: MeanKind
    num_objects: int
    chamfer: Estimate
    f_score: Estimate
    precision: Estimate
    recall: Estimate
    chamfer_by_size: dict[str, float]
    chamfer_by_coverage: dict[str, float]
    objects_by_size: dict[str, int]
    objects_by_coverage: dict[str, int]
    f_by_threshold: dict[str, float]


@dataclass(frozen=True)
class ScoreTable:
    """Rows of both kinds of mean, and the paper's.

    Attributes:
        rows: ours.
        paper: the paper's.
        threshold, chamfer_variant: what the scores were computed with.
    """

    rows: tuple[TableRow, ...]
    paper: tuple[PaperRow, ...]
    threshold: float
    chamfer_variant: str

    def to_json(self) -> dict[str, Any]:
        """Plain values, fractions of one except in the paper's rows, whose names say percent."""
        return {
            "threshold": self.threshold,
            "chamfer_variant": self.chamfer_variant,
            "rows": [asdict(row) for row in self.rows],
            "paper": [asdict(row) for row in self.paper],
        }


def score_table(
    clouds: Sequence[ScoredCloud], *, paper: Sequence[PaperRow] = PAPER_ROWS, seed: int = 0
) -> ScoreTable:
    """Sort scored clouds into rows, one for every method, condition, alignment and kind of mean.

    Args:
        clouds: in the order in which their rows shall come; each object once per row.
        paper: rows to compare with.
        seed: of the bootstrap. All rows draw alike, so that the same objects are drawn for every method.

    Raises:
        RadarError: no clouds, an unknown class, an object twice in a row, or scores of different metrics.
    """
    _require_comparable(clouds)
    groups: dict[tuple[str, str, str], list[ScoredCloud]] = {}
    for cloud in clouds:
        groups.setdefault((cloud.method, cloud.condition, cloud.alignment), []).append(cloud)
    for key, group in groups.items():
        name, times = Counter(cloud.object_name for cloud in group).most_common(1)[0]
        if times > 1:
            raise RadarError(f"{name} occurs {times} times for {', '.join(key)}: score each object once")
    rows = tuple(_row(group, kind, seed) for kind in MEAN_KINDS for group in groups.values())
    first = clouds[0].score
    return ScoreTable(rows, tuple(paper), first.threshold, first.chamfer_variant)


def _require_comparable(clouds: Sequence[ScoredCloud]) -> None:
    if not clouds:
        raise RadarError("no scored clouds: a table needs at least one")
    for cloud in clouds:
        if cloud.size_class not in SIZE_CLASSES or cloud.coverage_class not in (*COVERAGE_CLASSES, None):
            raise RadarError(
                f"{cloud.object_name}: unknown class {cloud.size_class!r} or {cloud.coverage_class!r}; "
                f"known are {', '.join(SIZE_CLASSES)} and {', '.join(COVERAGE_CLASSES)}"
            )
    metrics = {(cloud.score.threshold, cloud.score.chamfer_variant) for cloud in clouds}
    if len(metrics) > 1:
        raise RadarError(
            f"scores of {len(metrics)} different metrics cannot share a table: {sorted(metrics)}"
        )


def _row(group: Sequence[ScoredCloud], kind: MeanKind, seed: int) -> TableRow:
    sizes = [cloud.size_class for cloud in group]
    covered = [cloud for cloud in group if cloud.coverage_class is not None]
    coverages = [str(cloud.coverage_class) for cloud in covered]

    def estimate(figure: Callable[[ReconstructionScore], float]) -> Estimate:
        rng = np.random.default_rng([seed, zlib.crc32(b"table bootstrap")])
        return bootstrap_mean([figure(cloud.score) for cloud in group], sizes, rng, mean_kind=kind)

    f_by_threshold = {}
    for index, reported in enumerate(group[0].score.by_threshold):
        values = [cloud.score.by_threshold[index].f_score for cloud in group]
        mean = mean_of_class_means(values, sizes) if kind == "size_classes" else float(np.mean(values))
        f_by_threshold[f"{reported.threshold:g}"] = mean
    return TableRow(
        group[0].method,
        group[0].condition,
        group[0].alignment,
        kind,
        len(group),
        chamfer=estimate(lambda score: score.chamfer),
        f_score=estimate(lambda score: score.f_score),
        precision=estimate(lambda score: score.precision),
        recall=estimate(lambda score: score.recall),
        chamfer_by_size=_in_order(class_means([c.score.chamfer for c in group], sizes), SIZE_CLASSES),
        chamfer_by_coverage=_in_order(
            class_means([c.score.chamfer for c in covered], coverages), COVERAGE_CLASSES
        ),
        objects_by_size=_in_order(Counter(sizes), SIZE_CLASSES),
        objects_by_coverage=_in_order(Counter(coverages), COVERAGE_CLASSES),
        f_by_threshold=f_by_threshold,
    )


def _in_order(by_class: Mapping[str, _Number], names: Sequence[str]) -> dict[str, _Number]:
    return {name: by_class[name] for name in names if name in by_class}
