"""How well the level is chosen: rules, numbers of antennas, coherent or not, at several levels of noise, three seeds.

python level_selection.py TWIN > rows.jsonl        (a row a choice; the table on stderr)
"""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from signals import crop_of, scans_of, with_noise

from waveformer.datagen.twin_store import TwinScan
from waveformer.eval.ground_truth import reference_level
from waveformer.eval.mesh_distance import signed_distance_m
from waveformer.model.proposal import propose_surfaces
from waveformer.model.selection import SelectionSettings, select_levels
from waveformer.model.voxels import voxel_positions_m

SEEDS = 3
NOISE_DB = {"clean": None, "m40": 40.0, "m30": 30.0}
FAR_M = 8e-3


def choices() -> list[SelectionSettings]:
    """The default and mmNorm's loss by all rules, and mmNorm's own four bins for comparison."""
    complex_loss = [SelectionSettings(num_antennas=n) for n in (200, 50)]
    rules = itertools.product((200, 50), (True, False), ("argmin", "last_peak"))
    return [
        *complex_loss,
        *(
            SelectionSettings(num_antennas=n, coherent=coherent, loss="magnitude", choice=choice)
            for n, coherent, choice in rules
        ),
        SelectionSettings(num_antennas=50, window="mmnorm", loss="magnitude", choice="last_peak"),
    ]


def rows_of(scan: TwinScan, noise: str, seed: int) -> list[dict[str, Any]]:
    """Errors of every rule, of the largest component of one scan."""
    measurement = scan.measurement()
    if (snr_db := NOISE_DB[noise]) is not None:
        measurement = with_noise(measurement, snr_db, seed)
    proposal = propose_surfaces(measurement, crop=crop_of(scan), rng=np.random.default_rng(seed))
    if not proposal.fields:
        return []
    field, at = proposal.fields[0], proposal.levels_m[0]
    distance_m = signed_distance_m(voxel_positions_m(field.grid, field.index), scan.truth_mesh())
    reference_m = at[reference_level(field.potential_m, distance_m, at, float(np.diff(field.grid.x[:2])[0]))]
    rows = []
    for settings in choices():
        counts = [len(levels) for levels in proposal.levels_m]
        selection = select_levels(
            proposal.stacks, counts, measurement, settings, rng=np.random.default_rng(seed)
        )
        if selection.level_index[0] >= 0:
            error_m = float(at[selection.level_index[0]] - reference_m)
            rows.append(
                {
                    "object": scan.object_id,
                    "noise": noise,
                    "seed": seed,
                    "error_m": error_m,
                    **settings.model_dump(),
                }
            )
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """Median error and share of far ones, a line a rule."""
    lines = ["| rule | " + " | ".join(NOISE_DB) + " |", "|---" * (len(NOISE_DB) + 1) + "|"]
    for settings in choices():
        chosen = [
            row for row in rows if all(row[key] == value for key, value in settings.model_dump().items())
        ]
        cells = []
        for noise in NOISE_DB:
            errors = np.abs([row["error_m"] for row in chosen if row["noise"] == noise])
            cells.append(
                f"{1e3 * np.median(errors):.1f} mm, {100 * (errors > FAR_M).mean():.0f} %"
                if len(errors)
                else ""
            )
        echoes = "coherent" if settings.coherent else "incoherent"
        name = f"{settings.loss}, {settings.choice}, {settings.num_antennas} antennas, {echoes}"
        name += ", mmNorm's four bins" if settings.window == "mmnorm" else ""
        lines.append("| " + " | ".join([name, *cells]) + " |")
    return "\n".join(lines)


def main(root: Path) -> None:
    rows = []
    for scan in scans_of(root, "clean"):
        for noise, seed in itertools.product(NOISE_DB, range(SEEDS)):
            found = rows_of(scan, noise, seed)
            rows += found
            for row in found:
                print(json.dumps(row), flush=True)
    print(table(rows), file=sys.stderr)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
