"""One scan of a twin: proposed, turned into clouds by every method, scored against its truth."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from waveformer.datagen.farthest_points import farthest_points
from waveformer.datagen.surface_samples import sample_ground_truth
from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.datagen.twin_store import TwinScan
from waveformer.eval.alignment import Alignment, align_by_icp, known_pose
from waveformer.eval.classes import coverage_class, size_class
from waveformer.eval.ground_truth import reference_level
from waveformer.eval.mesh_distance import signed_distance_m
from waveformer.eval.methods import METHODS, MethodInput
from waveformer.eval.metrics import MAX_POINTS, coverage, score_reconstruction
from waveformer.model.confidence_default import DEFAULT_CONFIDENCE
from waveformer.model.imaging_volume import Volume
from waveformer.model.proposal import Proposal, ProposalSettings, choose_surfaces, propose_surfaces
from waveformer.model.voxels import voxel_positions_m
from waveformer.simulator.front_end_streams import generator
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.mesh import SurfaceMesh

ALIGNMENTS = ("known_pose", "icp")


def evaluate_scan(
    scan: TwinScan, methods: Sequence[str], settings: ProposalSettings, seed: int
) -> tuple[dict[str, Any], Proposal]:
    """Scores of every method, with and without registration, and what the choice of the level is worth.

    Args:
        scan: with its truth.
        methods: of `METHODS`.
        settings: of the proposal.
        seed: of antennas, background samples and completions.

    Returns:
        The record, JSON values; and the proposal, for pictures.
    """
    measurement, mesh = scan.measurement(), scan.truth_mesh()
    truth = sample_ground_truth(mesh, generator(seed, f"ground truth {scan.object_id}"))
    crop = Volume(*scan.crop_m)
    started = time.perf_counter()
    proposal = propose_surfaces(
        measurement, settings, crop=crop, rng=generator(seed, f"proposal {scan.object_id}")
    )
    seconds = time.perf_counter() - started
    given = MethodInput(
        proposal,
        _by_magnitude(proposal, measurement, settings, generator(seed, f"mmNorm {scan.object_id}")),
        float(scan.record["support_z_m"]),
        generator(seed, f"completion {scan.object_id}"),
    )
    partial = proposal.surface_m()
    share = coverage(partial, truth) if len(partial) else 0.0
    features = proposal.features(measurement)
    record = {
        "object_id": scan.object_id,
        "condition": scan.condition,
        "size_class": size_class(_longest_side_m(scan, mesh)),
        "coverage": share,
        "coverage_class": coverage_class(share),
        "seconds": seconds,
        "reason": proposal.reason,
        "warnings": list(proposal.warnings),
        "column_ratio": proposal.column_ratio() if len(partial) else None,
        "features": None if features is None else features._asdict(),
        "confidence": DEFAULT_CONFIDENCE.score(features),
        "levels": _level_errors(proposal, mesh),
        "scores": [row for name in methods for row in _scores(name, given, truth)],
    }
    return record, proposal


def _by_magnitude(
    proposal: Proposal, measurement: Measurement, settings: ProposalSettings, rng: np.random.Generator
) -> Proposal:
    """The choice that mmNorm's loss makes among the same candidates."""
    if not proposal.stacks:
        return proposal
    selection = settings.selection.model_copy(update={"loss": "magnitude"})
    by_magnitude = settings.model_copy(update={"selection": selection})
    return choose_surfaces(proposal, measurement, by_magnitude, rng=rng)


def _scores(name: str, given: MethodInput, truth: TruthCloud) -> list[dict[str, Any]]:
    cloud = METHODS[name](given)
    thinned = cloud[farthest_points(cloud, MAX_POINTS)]  # once: a rigid motion changes nothing in it
    alignments = [known_pose()] + (
        [align_by_icp(cloud, truth)] if len(cloud) >= 3 else [Alignment("icp", np.eye(4))]
    )
    return [
        {
            "method": name,
            "alignment": alignment.kind,
            "num_points": len(cloud),
            "moved_m": alignment.shift_m,
            "turned_deg": alignment.rotation_deg,
            "score": asdict(score_reconstruction(alignment.apply(thinned) if len(cloud) else cloud, truth)),
        }
        for alignment in alignments
    ]


def _level_errors(proposal: Proposal, mesh: SurfaceMesh) -> list[dict[str, Any]]:
    """Of every component: its size, the chosen level, and how far that is from the one nearest to the mesh."""
    found = []
    for field, at, chosen in zip(proposal.fields, proposal.levels_m, proposal.chosen_m, strict=True):
        if chosen is None:
            continue
        distance_m = signed_distance_m(voxel_positions_m(field.grid, field.index), mesh)
        spacing_m = float(field.grid.x[1] - field.grid.x[0])
        best = float(at[reference_level(field.potential_m, distance_m, at, spacing_m)])
        near = np.abs(field.potential_m - chosen) < spacing_m
        found.append(
            {
                "voxels": len(field.index),
                "num_levels": len(at),
                "chosen_m": chosen,
                "reference_m": best,
                "error_m": chosen - best,
                "median_distance_m": float(np.median(np.abs(distance_m[near]))) if near.any() else None,
            }
        )
    return found


def _longest_side_m(scan: TwinScan, mesh: SurfaceMesh) -> float:
    """Longest side of the object's box in the frame of its file."""
    turned = np.asarray(scan.record["pose"])[:3, :3]
    return float(np.ptp(mesh.vertices_m @ turned, axis=0).max())
