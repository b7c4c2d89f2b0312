from types import SimpleNamespace

import numpy as np

from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.eval import scan_evaluation
from waveformer.eval.alignment import Alignment
from waveformer.eval.methods import METHODS, MethodInput
from waveformer.model.proposal import Proposal, ProposalSettings


def test_each_alignment_is_applied_before_its_score(monkeypatch, rng):
    """A perfect cloud, and a registration that moves it away: the known pose scores it as it is, the other as moved."""
    points = rng.normal(size=(20_000, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1, keepdims=True)
    away = np.eye(4)
    away[:3, 3] = 0.2
    monkeypatch.setitem(scan_evaluation.METHODS, "perfect", lambda given: points)
    monkeypatch.setattr(scan_evaluation, "align_by_icp", lambda cloud, truth: Alignment("icp", away))
    known, moved = scan_evaluation._scores("perfect", None, TruthCloud(points[::4]))
    assert (known["alignment"], moved["alignment"]) == ("known_pose", "icp")
    assert known["score"]["precision"] > 0.99 and moved["score"]["precision"] == 0.0
    assert known["num_points"] == 20_000 and known["score"]["num_points"] == 16_384


def test_an_empty_cloud_has_the_worst_score(monkeypatch, rng):
    monkeypatch.setitem(scan_evaluation.METHODS, "nothing", lambda given: np.empty((0, 3)))
    rows = scan_evaluation._scores("nothing", None, TruthCloud(rng.normal(size=(100, 3))))
    assert [row["score"]["chamfer"] for row in rows] == [1.0, 1.0]


def test_mmnorm_chooses_by_magnitudes_among_the_same_candidates(monkeypatch):
    asked = []

    def choose(proposal, measurement, settings, *, rng):
        asked.append((proposal, measurement, settings.selection.loss))
        return "by magnitude"

    monkeypatch.setattr(scan_evaluation, "choose_surfaces", choose)
    proposal = Proposal(None, None, stacks=("stack",))
    given = ("measurement", ProposalSettings(), np.random.default_rng(0))
    assert scan_evaluation._by_magnitude(proposal, *given) == "by magnitude"
    assert asked == [(proposal, "measurement", "magnitude")]
    nothing = Proposal(None, None)
    assert scan_evaluation._by_magnitude(nothing, *given) is nothing


def test_each_method_takes_its_own_choice():
    clouds = [
        SimpleNamespace(
            surface_m=lambda name=name: f"{name} points", voxels_m=lambda name=name: f"{name} voxels"
        )
        for name in ("ours", "theirs")
    ]
    given = MethodInput(*clouds, 0.0, np.random.default_rng(0))
    assert METHODS["proposal"](given) == "ours points"
    assert METHODS["mmnorm"](given) == "theirs points"
    assert METHODS["mmnorm_voxels"](given) == "theirs voxels"
