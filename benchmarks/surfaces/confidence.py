"""Confidence against the paper's ratio: how well each tells good clouds from bad ones, over several kinds of failure.

python confidence.py measure TWIN > rows.jsonl       (a row a reconstruction)
python confidence.py report FITTED.jsonl JUDGED.jsonl    (fit on the objects of one, curves over those of the other)
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from signals import crop_of, scans_of, sparse, with_noise, wrong_depth

from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.eval.metrics import score_reconstruction
from waveformer.model.confidence import Confidence, fit_confidence
from waveformer.model.proposal import propose_surfaces
from waveformer.simulator import Measurement

GOOD_PRECISION = 0.6
PENALTIES = (1.0, 3.0, 10.0, 30.0, 100.0)

Rows = list[dict[str, Any]]
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
    "wrong depth": ("clean", wrong_depth),
    "sheet and rows": ("box", lambda scan, rng: scan),
    "sheet": ("sheet", lambda scan, rng: scan),
}


def area_under_curve(score: NDArray[np.float64], good: NDArray[np.bool_]) -> float:
    """Chance that a good cloud scores higher than a bad one (Mann & Whitney); NaN without both."""
    if good.all() or not good.any():
        return float("nan")
    above, below = score[good][:, None], score[~good]
    return float(((above > below) + 0.5 * (above == below)).mean())


def measure(root: Path) -> Iterable[dict[str, Any]]:
    """A row for every object and kind that the twin has."""
    for number, (kind, (condition, spoil)) in enumerate(KINDS.items()):
        for place, scan in enumerate(scans_of(root, condition)):
            truth = sample_ground_truth(scan.truth_mesh(), np.random.default_rng(0))
            measurement = spoil(scan.measurement(), np.random.default_rng([number, place]))
            proposal = propose_surfaces(measurement, crop=crop_of(scan), rng=np.random.default_rng(0))
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


def is_good(rows: Rows) -> NDArray[np.bool_]:
    """Whether each cloud is good."""
    return np.array([row["precision"] > GOOD_PRECISION for row in rows])


def fit(rows: Rows) -> Confidence:
    """With the penalty that does best on objects left out one by one."""
    objects = np.array([row["object"] for row in rows])
    features, good = np.array([row["features"] for row in rows]), is_good(rows)

    def left_out(penalty: float) -> float:
        score = np.empty(len(rows))
        for name in set(objects.tolist()):
            own = objects == name
            fitted = fit_confidence(features[~own], good[~own], penalty)
            score[own] = [fitted.score(row) for row in features[own]]
        return area_under_curve(score, good)

    areas = {penalty: left_out(penalty) for penalty in PENALTIES}
    best = max(areas, key=areas.__getitem__)
    print(f"penalty {best:g}, area with objects left out one by one {areas[best]:.3f}")
    return fit_confidence(features, good, best)


def report(fitted: Confidence, rows: Rows) -> str:
    """Areas under the curves by kind, each judged among clean scans: it alone may be all bad."""
    good, kinds = is_good(rows), np.array([row["kind"] for row in rows])
    ours = np.array([fitted.score(row["features"]) for row in rows])
    ratio = -np.array([row["ratio"] for row in rows])
    lines = ["| failure | good of all | ours | the paper's ratio |", "|---|---|---|---|"]
    means = []
    for kind in [name for name in KINDS if name != "clean" and name in kinds]:
        chosen = np.isin(kinds, ["clean", kind])
        areas = [area_under_curve(values[chosen], good[chosen]) for values in (ours, ratio)]
        own = good[kinds == kind]
        lines.append(f"| {kind} | {int(own.sum())} of {len(own)} | {areas[0]:.2f} | {areas[1]:.2f} |")
        means.append(areas)
    lines.append(f"| mean | | {np.mean(means, axis=0)[0]:.2f} | {np.mean(means, axis=0)[1]:.2f} |")
    total = [area_under_curve(values, good) for values in (ours, ratio)]
    lines.append(f"| all together | {int(good.sum())} of {len(good)} | {total[0]:.2f} | {total[1]:.2f} |")
    return "\n".join(lines)


def read_rows(path: str) -> Rows:
    """What `measure` printed."""
    return [json.loads(line) for line in Path(path).read_text().splitlines()]


if __name__ == "__main__":
    if sys.argv[1] == "measure":
        for row in measure(Path(sys.argv[2])):
            print(json.dumps(row), flush=True)
    else:
        confidence = fit(read_rows(sys.argv[2]))
        print(json.dumps(dataclasses.asdict(confidence)))
        print(report(confidence, read_rows(sys.argv[3])))
