"""Confidence against the paper's ratio: how well each tells good clouds from bad ones, over several kinds of failure.

python confidence.py measure TWIN [KIND ...] > rows.jsonl       (a row a reconstruction)
python confidence.py report ROWS.jsonl ...           (curves of held-out halves; coefficients of all objects together)
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from signals import crop_of, scans_of, sparse, with_noise, wrong_depth

from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.eval.metrics import score_reconstruction
from waveformer.model.confidence import Confidence, fit_confidence
from waveformer.model.proposal import Proposal, propose_surfaces
from waveformer.simulator import Measurement

GOOD_PRECISION = 0.6
PENALTY = 10.0
# A delay that nobody knows of moves every echo alike, and so does another level of the potential: it cannot be seen.
UNKNOWABLE = "unknown delay"

Spoil = Callable[[Measurement, np.random.Generator], Measurement]


def _noise(mirror_snr_db: float) -> Spoil:
    return lambda scan, rng: with_noise(scan, mirror_snr_db, int(rng.integers(2**31)))


# kind: condition of the twin, and what is done to its signal
KINDS: dict[str, tuple[str, Spoil]] = {
    "clean": ("clean", _noise(45.0)),
    "white noise 30": ("clean", _noise(30.0)),
    "white noise 20": ("clean", _noise(20.0)),
    "row error": ("rows", lambda scan, rng: scan),
    "sparse aperture": ("clean", sparse),
    "wrong depth": ("clean", _noise(45.0)),
    "unknown delay": ("clean", wrong_depth),
    "sheet and rows": ("box", lambda scan, rng: scan),
    "sheet": ("sheet", lambda scan, rng: scan),
}


def area_under_curve(score: NDArray[np.float64], good: NDArray[np.bool_]) -> float:
    """Chance that a good cloud scores higher than a bad one (Mann & Whitney); NaN without both."""
    if good.all() or not good.any():
        return float("nan")
    above, below = score[good][:, None], score[~good]
    return float(((above > below) + 0.5 * (above == below)).mean())


def measure(root: Path, kinds: Collection[str]) -> Iterable[dict[str, Any]]:
    """A row for every object and kind that the twin has."""
    for number, (kind, (condition, spoil)) in enumerate(KINDS.items()):
        if kind not in kinds:
            continue
        for place, scan in enumerate(scans_of(root, condition)):
            truth = sample_ground_truth(scan.truth_mesh(), np.random.default_rng(0))
            measurement = spoil(scan.measurement(), np.random.default_rng([number, place]))
            proposal = propose_surfaces(measurement, crop=crop_of(scan), rng=np.random.default_rng(0))
            if kind == "wrong depth":
                proposal = at_another_level(proposal, np.random.default_rng([number, place]))
            features = proposal.features(measurement)
            if features is None:
                continue
            yield {
                "object": scan.object_id,
                "kind": kind,
                "precision": score_reconstruction(proposal.surface_m(), truth).precision,
                "ratio": proposal.column_ratio(),
                "features": list(features),
            }


def at_another_level(proposal: Proposal, rng: np.random.Generator) -> Proposal:
    """The same candidates, but every component 10 to 25 mm from its choice, where it has such a level."""
    if proposal.selection is None:
        return proposal
    moved = []
    for at, chosen in zip(proposal.levels_m, proposal.selection.level_index, strict=True):
        away_m = np.abs(at - at[chosen]) if chosen >= 0 else np.empty(0)
        far = np.flatnonzero((away_m > 0.010) & (away_m < 0.025))
        moved.append(int(rng.choice(far)) if len(far) else chosen)
    return dataclasses.replace(
        proposal, selection=dataclasses.replace(proposal.selection, level_index=tuple(moved))
    )


class Table(NamedTuple):
    """Rows of several twins as arrays: features (n, F), whether each cloud is good, kind, object, the paper's ratio."""

    features: NDArray[np.float64]
    good: NDArray[np.bool_]
    kind: NDArray[np.str_]
    name: NDArray[np.str_]
    ratio: NDArray[np.float64]

    @classmethod
    def read(cls, paths: list[str]) -> Table:
        """What `measure` printed."""
        rows = [json.loads(line) for path in paths for line in Path(path).read_text().splitlines()]
        return cls(
            np.array([row["features"] for row in rows]),
            np.array([row["precision"] > GOOD_PRECISION for row in rows]),
            np.array([row["kind"] for row in rows]),
            np.array([row["object"] for row in rows]),
            np.array([row["ratio"] for row in rows]),
        )

    def take(self, chosen: NDArray[np.bool_]) -> Table:
        """Some of the rows."""
        return Table(*(values[chosen] for values in self))


def fit(table: Table) -> Confidence:
    """On every kind but the one that cannot be known."""
    known = table.kind != UNKNOWABLE
    return fit_confidence(table.features[known], table.good[known], PENALTY)


def areas(score: NDArray[np.float64], table: Table) -> dict[str, float]:
    """Area by kind, each judged among clean scans: it alone may be all bad."""
    found = {}
    for kind in [name for name in KINDS if name != "clean" and name in table.kind]:
        chosen = np.isin(table.kind, ["clean", kind])
        found[kind] = area_under_curve(score[chosen], table.good[chosen])
    return found


def report(table: Table) -> str:
    """Fitted on every second object, judged on the others, both ways round."""
    names = sorted(set(table.name.tolist()))
    half = np.array([names.index(name) % 2 for name in table.name])
    columns, counts = [], []
    for judged in (0, 1):
        others = table.take(half == judged)
        fitted = fit(table.take(half != judged))
        columns += [
            areas(np.array([fitted.score(row) for row in others.features]), others),
            areas(-others.ratio, others),
        ]
        counts.append(len(set(others.name.tolist())))
    lines = [
        f"| failure | good of all | ours, {counts[0]} objects | the paper's ratio | ours, the other {counts[1]} | the paper's ratio |",
        "|---|---|---|---|---|---|",
    ]
    kinds = [kind for kind in columns[0] if kind != UNKNOWABLE]
    for kind in [*kinds, UNKNOWABLE]:
        own = table.good[table.kind == kind]
        cells = " | ".join(f"{column.get(kind, float('nan')):.2f}" for column in columns)
        lines.append(f"| {kind} | {int(own.sum())} of {len(own)} | {cells} |")
        if kind == kinds[-1]:
            cells = " | ".join(
                f"{np.nanmean([column.get(name, np.nan) for name in kinds]):.2f}" for column in columns
            )
            lines.append(f"| **mean** | | {cells} |")
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1] == "measure":
        for row in measure(Path(sys.argv[2]), sys.argv[3:] or KINDS):
            print(json.dumps(row), flush=True)
    else:
        everything = Table.read(sys.argv[2:])
        print(report(everything))
        print(json.dumps(dataclasses.asdict(fit(everything))))
