"""How much of the surface that a clean signal shows a geometric partial has, for every reading of Eq. 2 and 3.

    python benchmarks/partials/agreement.py TWIN > rows.jsonl      (a row an object and reading; the table on stderr)

TWIN is a folder of `waveformer twin` with scans of condition "clean". A point of the truth is covered if a point of the cloud
is nearer than 0.08 radii; IoU = points that partial and candidate cover, over points that one of them covers. The candidate
is the one that is chosen from the object's signal, or that nearest to the mesh of those it chose from.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from waveformer.datagen.partials import PartialSettings, draw_partial, view_of
from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.datagen.twin_store import TwinScan, twin_scans
from waveformer.eval.ground_truth import reference_level
from waveformer.eval.mesh_distance import signed_distance_m
from waveformer.eval.metrics import THRESHOLD
from waveformer.model.imaging_volume import Volume
from waveformer.model.proposal import Proposal, propose_surfaces
from waveformer.model.surfaces import surface_points
from waveformer.model.voxels import voxel_positions_m
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.runtime import activate
from waveformer.simulator.scene import build_scene

# A level this far from the one nearest to the mesh is wrong: two steps.
WRONG_M = 4e-3


def settings_of(
    tau: float, reading: str = "none", tilts: tuple[float, float] = (90.0, 90.0), **more: Any
) -> PartialSettings:
    return PartialSettings(
        tau_deg=(tau, tau),
        reading=reading,
        tau_h_deg=(tilts[0],) * 2,
        tau_v_deg=(tilts[1],) * 2,
        noise=None,
        num_points=1 << 20,
        **more,
    )


READINGS: dict[str, PartialSettings] = {
    **{f"Eq. 2, true aperture, tau {tau}": settings_of(tau) for tau in (2, 5, 10, 20)},
    "visible like to a camera (tau 90)": settings_of(90),
    "Eq. 2, tau 5, hidden-point removal": settings_of(5, visibility="hidden_point_removal"),
    **{
        f"Eq. 2, centre sensor, tau {tau}": settings_of(tau, aperture="centre")
        for tau in (15, 20, 25, 30, 35, 40)
    },
    "Eq. 3, tilt 10 / 10, no Eq. 2": settings_of(90, "tilt", (10, 10)),
    "Eq. 3, tilt 25 / 30, no Eq. 2": settings_of(90, "tilt", (25, 30)),
    "Eq. 3, tilt 40 / 40, no Eq. 2": settings_of(90, "tilt", (40, 40)),
    "Eq. 2, tau 5, and Eq. 3, tilt 25 / 30": settings_of(5, "tilt", (25, 30)),
    **{
        f"Eq. 2, tau 5, and Eq. 3, literal {tau} / {tau}": settings_of(5, "literal", (tau, tau))
        for tau in (60, 75, 90)
    },
}


def covered(points_m: NDArray[np.float64], truth: TruthCloud) -> NDArray[np.bool_]:
    """Which points of the truth have one of the cloud nearby, (G,)."""
    if len(points_m) == 0:
        return np.zeros(len(truth.points_m), dtype=bool)
    near, _ = KDTree(truth.to_unit_sphere(points_m)).query(truth.tree.data, distance_upper_bound=THRESHOLD)
    return np.asarray(near < THRESHOLD)


def nearest_surface(proposal: Proposal, mesh: SurfaceMesh) -> tuple[NDArray[np.float64], float]:
    """Of the components with a chosen level the levels nearest to the mesh, and how far off the largest one's choice is."""
    clouds, error_m = [np.empty((0, 3))], None
    for field, at, chosen in zip(proposal.fields, proposal.levels_m, proposal.chosen_m, strict=True):
        if chosen is None:
            continue
        distance_m = signed_distance_m(voxel_positions_m(field.grid, field.index), mesh)
        best = float(
            at[reference_level(field.potential_m, distance_m, at, float(np.diff(field.grid.x[:2])[0]))]
        )
        clouds.append(surface_points(field, best).points_m)
        error_m = chosen - best if error_m is None else error_m
    return np.concatenate(clouds), float("nan") if error_m is None else error_m


def rows_of(scan: TwinScan) -> list[dict[str, Any]]:
    """A row for every reading."""
    measurement, mesh = scan.measurement(), scan.truth_mesh()
    truth = sample_ground_truth(mesh, generator(0, f"ground truth {scan.object_id}"))
    proposal = propose_surfaces(
        measurement, crop=Volume(*scan.crop_m), rng=generator(0, f"proposal {scan.object_id}")
    )
    nearest_m, error_m = nearest_surface(proposal, mesh)
    chosen, nearest = covered(proposal.surface_m(), truth), covered(nearest_m, truth)
    scene = build_scene([(mesh.vertices_m, mesh.faces)])
    rows = []
    for name, settings in READINGS.items():
        view = view_of(
            truth, measurement.aperture, scene, two_sided=mesh.two_sided, visibility=settings.visibility
        )
        # Not thinned: every kept point covers.
        own = covered(draw_partial(view, settings, np.random.default_rng(0)).points_m, truth)
        rows.append(
            {
                "object": scan.object_id,
                "reading": name,
                "level_error_m": error_m,
                "coverage": float(own.mean()),
                "signal_coverage": float(chosen.mean()),
                "iou": overlap(own, chosen),
                "iou_nearest": overlap(own, nearest),
            }
        )
    return rows


def overlap(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    return float((one & other).sum() / max(1, (one | other).sum()))


def table(rows: list[dict[str, Any]]) -> str:
    """Means of every reading, and the objects whose level is wrong."""
    wrong = {row["object"]: row["level_error_m"] for row in rows if abs(row["level_error_m"]) > WRONG_M}
    lines = [
        "| kept | IoU, all | IoU, level right | IoU, nearest level | coverage |",
        "|---|---|---|---|---|",
    ]
    for name in READINGS:
        own = [row for row in rows if row["reading"] == name]
        right = [row for row in own if row["object"] not in wrong]
        cells = [np.mean([row["iou"] for row in part]) for part in (own, right)]
        cells += [np.mean([row[key] for row in own]) for key in ("iou_nearest", "coverage")]
        lines.append(f"| {name} | " + " | ".join(f"{value:.3f}" for value in cells) + " |")
    seen = {row["object"]: row["signal_coverage"] for row in rows}
    lines.append(
        f"{len(seen)} objects; the candidates cover {np.mean(list(seen.values())):.3f} of the truth."
    )
    lines += [f"wrong level: {name}, {1e3 * error:+.1f} mm" for name, error in wrong.items()]
    return "\n".join(lines)


def main(root: Path) -> None:
    activate(num_threads=1)
    rows = []
    for scan in twin_scans(root):
        if scan.condition == "clean":
            found = rows_of(scan)
            rows += found
            for row in found:
                print(json.dumps(row), flush=True)
    print(table(rows), file=sys.stderr)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
