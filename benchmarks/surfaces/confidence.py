"""Confidence against the paper's ratio: how well each tells good clouds from bad ones, over several kinds of failure.

    python confidence.py TWIN > rows.jsonl        (a row a reconstruction; fit, curves and coefficients on stderr)

Fitted on every second object, reported on the others, and the other way round.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from signals import crop_of, scans_of, sparse, with_noise, wrong_depth

from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.eval.metrics import score_reconstruction
from waveformer.model.confidence import fit_confidence
from waveformer.model.proposal import propose_surfaces
from waveformer.simulator import Measurement

SEEDS = 2
GOOD_PRECISION = 0.6

Spoil = Callable[[Measurement, np.random.Generator], Measurement]
# kind: condition of the twin, and what is done to its signal
KINDS: dict[str, tuple[str, Spoil]] = {
    "clean": ("clean", lambda scan, rng: with_noise(scan, 45.0, int(rng.integers(2**31)))),
    "white noise 30": ("clean", lambda scan, rng: with_noise(scan, 30.0, int(rng.integers(2**31)))),
    "white noise 20": ("clean", lambda scan, rng: with_noise(scan, 20.0, int(rng.integers(2**31)))),
    "row error": ("rows", lambda scan, rng: scan),
    "sheet": ("sheet", lambda scan, rng: scan),
    "sheet and rows": ("box", lambda scan, rng: scan),
    "sparse aperture": ("clean", sparse),
    "wrong depth": ("clean", wrong_depth),
}


def area_under_curve(score: NDArray[np.float64], good: NDArray[np.bool_]) -> float:
    """Chance that a good cloud scores higher than a bad one (Mann & Whitney); NaN without both."""
    if good.all() or not good.any():
        return float("nan")
    above, below = score[good][:, None], score[~good]
    return float(((above > below) + 0.5 * (above == below)).mean())


def measure(root: Path) -> list[dict[str, Any]]:
    """A row for every object, kind and seed."""
    rows = []
    for kind, (condition, spoil) in KINDS.items():
        for scan in scans_of(root, condition):
            truth = sample_ground_truth(scan.truth_mesh(), np.random.default_rng(0))
            for seed in range(SEEDS):
                rng = np.random.default_rng([seed, len(rows)])
                measurement = spoil(scan.measurement(), rng)
                proposal = propose_surfaces(measurement, crop=crop_of(scan), rng=np.random.default_rng(seed))
                features = proposal.features(measurement)
                if features is None:
                    continue
                score = score_reconstruction(proposal.surface_m(), truth)
                rows.append(
                    {
                        "object": scan.object_id,
                        "kind": kind,
                        "seed": seed,
                        "precision": score.precision,
                        "ratio": proposal.column_ratio(),
                        "features": list(features),
                    }
                )
                print(json.dumps(rows[-1]), flush=True)
    return rows


def report(rows: list[dict[str, Any]]) -> str:
    """Areas under the curves, by kind and over all, of objects that the fit has not seen."""
    objects = sorted({row["object"] for row in rows})
    half = np.array([objects.index(row["object"]) % 2 for row in rows])
    good = np.array([row["precision"] > GOOD_PRECISION for row in rows])
    features = np.array([row["features"] for row in rows])
    ratio = -np.array([row["ratio"] for row in rows])
    kinds = np.array([row["kind"] for row in rows])
    ours = np.empty(len(rows))
    lines = []
    for part in (0, 1):
        fitted = fit_confidence(features[half != part], good[half != part])
        ours[half == part] = [fitted.score(row) for row in features[half == part]]
        own = [area_under_curve(values[half == part], good[half == part]) for values in (ours, ratio)]
        lines.append(f"half {part}: ours {own[0]:.3f}, the paper's ratio {own[1]:.3f}")
    lines += ["| failure | good of all | ours | the paper's ratio |", "|---|---|---|---|"]
    for kind in [*list(KINDS)[1:], "all"]:
        # a kind is judged among clean scans: it alone may be all bad
        chosen = np.ones(len(rows), bool) if kind == "all" else np.isin(kinds, ["clean", kind])
        areas = [area_under_curve(values[chosen], good[chosen]) for values in (ours, ratio)]
        own_kind = good[kinds == kind] if kind != "all" else good
        lines.append(
            f"| {kind} | {int(own_kind.sum())} of {len(own_kind)} | {areas[0]:.2f} | {areas[1]:.2f} |"
        )
    lines.append(json.dumps(dataclasses.asdict(fit_confidence(features[half == 0], good[half == 0]))))
    return "\n".join(lines)


if __name__ == "__main__":
    source = Path(sys.argv[1])
    # rows from an earlier run, or measured now
    known = (
        [json.loads(line) for line in source.read_text().splitlines()]
        if source.is_file()
        else measure(source)
    )
    print(report(known), file=sys.stderr)
