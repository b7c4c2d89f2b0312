"""All scans of a twin evaluated, one file of scores each, and the table of them beside the paper's rows."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from waveformer import __version__
from waveformer.datagen.twin_store import TwinScan, twin_scans
from waveformer.eval.metrics import ChamferDistances, ReconstructionScore, ThresholdScore
from waveformer.eval.proposal_figure import proposal_figure
from waveformer.eval.scan_evaluation import evaluate_scan
from waveformer.eval.table import ScoredCloud, ScoreTable, score_table
from waveformer.model.proposal import ProposalSettings
from waveformer.simulator.errors import StoreError
from waveformer.simulator.storage import publish_file

_FORMAT, _VERSION = "waveformer.evaluation", 1


def evaluate_twin(
    root: Path,
    out: Path,
    methods: Sequence[str],
    *,
    conditions: Sequence[str] = (),
    settings: ProposalSettings | None = None,
    seed: int = 0,
    pictures: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[ScoreTable, list[dict[str, Any]]]:
    """Scores of all scans of a twin. What is there from an earlier run with the same settings is kept.

    Args:
        root: the twin.
        out: folder for one JSON file and one picture per scan.
        methods: of `methods.METHODS`.
        conditions: only these; none means all.
        settings: of the proposal.
        seed: of antennas, background samples and completions.
        pictures: whether to draw every scan.
        progress: called with (scans done, scans in all).

    Returns:
        The table, and the record of every scan.

    Raises:
        StoreError: the twin has no scan of these conditions, or cannot be read.
    """
    settings = settings or ProposalSettings()
    scans = twin_scans(root)
    known = sorted({scan.condition for scan in scans})
    if missing := sorted(set(conditions) - set(known)):
        raise StoreError(f"{root} has no scans of {', '.join(missing)}; it has {', '.join(known) or 'none'}")
    scans = [scan for scan in scans if not conditions or scan.condition in conditions]
    if not scans:
        raise StoreError(f"{root} holds no finished scan: run waveformer twin first")
    records = []
    for done, scan in enumerate(scans):
        records.append(_evaluated(scan, out, list(methods), settings, seed, pictures))
        if progress is not None:
            progress(done + 1, len(scans))
    return score_table([cloud for record in records for cloud in _clouds(record)], seed=seed), records


def _evaluated(
    scan: TwinScan, out: Path, methods: list[str], settings: ProposalSettings, seed: int, pictures: bool
) -> dict[str, Any]:
    """The record of a scan, from its file if that has the same identity."""
    identity = {
        "scan": scan.record["identity"],
        "methods": methods,
        "settings": settings.model_dump(),
        "seed": seed,
        "waveformer_version": __version__,
    }
    identity = json.loads(json.dumps(identity))
    path = out / scan.condition / f"{scan.object_id}.json"
    picture = path.with_suffix(".png")
    if path.is_file() and (picture.is_file() or not pictures):
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if found.get("format") == _FORMAT and found.get("identity") == identity:
            return found
    record, proposal = evaluate_scan(scan, methods, settings, seed)
    record = {"format": _FORMAT, "version": _VERSION, "identity": identity, **record}
    path.parent.mkdir(parents=True, exist_ok=True)
    if pictures:
        with publish_file(picture, overwrite=True) as temporary:
            proposal_figure(
                proposal, scan.truth_mesh(), temporary, title=f"{scan.object_id}, {scan.condition}"
            )
    with publish_file(path, overwrite=True) as temporary:
        temporary.write_text(json.dumps(record, indent=1), encoding="utf-8")
    return record


def _clouds(record: dict[str, Any]) -> list[ScoredCloud]:
    return [
        ScoredCloud(
            row["method"],
            record["condition"],
            row["alignment"],
            record["object_id"],
            record["size_class"],
            record["coverage_class"],
            _score(row["score"]),
        )
        for row in record["scores"]
    ]


def _score(values: dict[str, Any]) -> ReconstructionScore:
    by_threshold = tuple(ThresholdScore(**part) for part in values["by_threshold"])
    distances = ChamferDistances(**values["chamfer_distances"])
    return ReconstructionScore(**{**values, "by_threshold": by_threshold, "chamfer_distances": distances})
