"""Rows of the Wave-Former paper's tables (arXiv 2511.14152), as far as the project's reference documents give them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperRow:
    """What the paper prints for one method; None where the documents give no figure.

    Attributes:
        method: name in the paper.
        condition: "all" (line of sight and occluded together), "los" or "occluded".
        chamfer: Chamfer distance, in radii of the unit sphere.
        f_percent, precision_percent, recall_percent: in percent.
        chamfer_by_size: of large, medium and small objects.
        chamfer_by_coverage: of high, middle and low coverage.
        source: document and section that gives the figures.
    """

    method: str
    condition: str
    chamfer: float
    source: str
    f_percent: float | None = None
    precision_percent: float | None = None
    recall_percent: float | None = None
    chamfer_by_size: tuple[float, float, float] | None = None
    chamfer_by_coverage: tuple[float, float, float] | None = None


PAPER_ROWS = (
    PaperRow(
        method="Backprojection",
        condition="all",
        chamfer=0.180,
        f_percent=40,
        precision_percent=43,
        recall_percent=45,
        chamfer_by_size=(0.092, 0.152, 0.293),
        chamfer_by_coverage=(0.076, 0.140, 0.325),
        source="surface_proposal.md, section 1: table and the line on coverage classes",
    ),
    PaperRow(
        method="mmNorm",
        condition="all",
        chamfer=0.214,
        f_percent=45,
        precision_percent=89,
        recall_percent=34,
        chamfer_by_size=(0.078, 0.201, 0.361),
        chamfer_by_coverage=(0.064, 0.155, 0.434),
        source="surface_proposal.md, section 1: table and the line on coverage classes; networks.md, section 5",
    ),
    PaperRow(
        method="mmNorm",
        condition="los",
        chamfer=0.198,
        f_percent=46,
        source="surface_proposal.md, sections 1 and 2: line of sight",
    ),
    PaperRow(
        method="mmNorm",
        condition="occluded",
        chamfer=0.231,
        f_percent=44,
        source="surface_proposal.md, section 2: change from line of sight to occluded",
    ),
    PaperRow(
        method="Wave-Former",
        condition="all",
        chamfer=0.069,
        f_percent=75,
        precision_percent=85,
        recall_percent=72,
        source="networks.md, section 5: the completions' target, and the line on means",
    ),
)
