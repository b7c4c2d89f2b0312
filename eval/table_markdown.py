"""The table of methods and conditions as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from waveformer.eval.bootstrap import Estimate
from waveformer.eval.classes import COVERAGE_CLASSES, SIZE_CLASSES
from waveformer.eval.paper_rows import PaperRow
from waveformer.eval.table import MEAN_KINDS, ScoreTable, TableRow

_MISSING = "–"
_HEADINGS = (
    "method",
    "condition",
    "alignment",
    "objects",
    "CD",
    "F %",
    "P %",
    "R %",
    f"CD {'/'.join(SIZE_CLASSES)}",
    f"CD {'/'.join(COVERAGE_CLASSES)} coverage",
)


def to_markdown(table: ScoreTable) -> str:
    """One table for each kind of mean, the paper's rows at the end of each."""
    note = (
        f"Lengths in radii of the unit sphere around the ground truth; P, R, F at {table.threshold:g}; "
        f"CD = {table.chamfer_variant}; F is computed for each object, then averaged. "
        "In brackets: 95 % bootstrap intervals over objects, drawn within size classes."
    )
    parts = [note]
    for kind, title in MEAN_KINDS.items():
        lines = [_line(_HEADINGS), _line(["---"] * len(_HEADINGS))]
        lines += [_line(_cells(row)) for row in table.rows if row.mean_kind == kind]
        lines += [_line(_paper_cells(row)) for row in table.paper]
        parts.append(f"### {title[0].upper()}{title[1:]}\n\n" + "\n".join(lines))
    parts.append(
        "The paper's rows are the same in both tables: it does not say its kind of mean, but its overall CD is the "
        "mean of its size rows."
    )
    return "\n\n".join(parts) + "\n"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def _cells(row: TableRow) -> list[str]:
    return [
        row.method,
        row.condition,
        row.alignment,
        str(row.num_objects),
        _chamfer(row.chamfer),
        *(_percent(estimate) for estimate in (row.f_score, row.precision, row.recall)),
        _by_class(row.chamfer_by_size, row.objects_by_size, SIZE_CLASSES),
        _by_class(row.chamfer_by_coverage, row.objects_by_coverage, COVERAGE_CLASSES),
    ]


def _chamfer(estimate: Estimate) -> str:
    return f"{estimate.mean:.3f} [{estimate.low:.3f}, {estimate.high:.3f}]"


def _percent(estimate: Estimate) -> str:
    return f"{100 * estimate.mean:.0f} [{100 * estimate.low:.0f}, {100 * estimate.high:.0f}]"


def _by_class(means: Mapping[str, float], objects: Mapping[str, int], names: Sequence[str]) -> str:
    figures = "/".join(f"{means[name]:.3f}" if name in means else _MISSING for name in names)
    return f"{figures} (n {'/'.join(str(objects.get(name, 0)) for name in names)})"


def _paper_cells(row: PaperRow) -> list[str]:
    return [
        f"{row.method} (paper)",
        row.condition,
        _MISSING,
        _MISSING,
        f"{row.chamfer:.3f}",
        *(
            _MISSING if percent is None else f"{percent:.0f}"
            for percent in (row.f_percent, row.precision_percent, row.recall_percent)
        ),
        *(
            _MISSING if values is None else "/".join(f"{value:.3f}" for value in values)
            for values in (row.chamfer_by_size, row.chamfer_by_coverage)
        ),
    ]
