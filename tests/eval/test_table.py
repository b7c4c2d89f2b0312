"""Rows of the table: groups, both kinds of mean, and what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest

from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.eval.metrics import score_reconstruction
from waveformer.eval.table import ScoredCloud, score_table
from waveformer.eval.table_markdown import to_markdown
from waveformer.simulator.errors import RadarError

_TRUTH = TruthCloud(np.array([(1.0, 0, 0), (-1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0)]))


def scored(chamfer, size, name, *, coverage="high", method="mmnorm", condition="los"):
    """A cloud whose every truth point was moved up by `chamfer` radii."""
    score = score_reconstruction(_TRUTH.points_m + [0, 0, chamfer], _TRUTH)
    return ScoredCloud(method, condition, "known_pose", name, size, coverage, score)


CLOUDS = [
    scored(0.05, "large", "hammer"),
    scored(0.1, "small", "ball", coverage="low"),
    scored(0.3, "small", "lemon", coverage=None),
]


def test_both_kinds_of_mean():
    by_class, by_object = score_table(CLOUDS).rows
    assert (by_class.mean_kind, by_object.mean_kind) == ("size_classes", "objects")
    assert by_class.chamfer.mean == pytest.approx((0.05 + 0.2) / 2)
    assert by_object.chamfer.mean == pytest.approx(0.15)
    assert by_class.f_score.mean == pytest.approx(0.5)
    assert by_object.f_score.mean == pytest.approx(1 / 3)
    # One large object; two small ones, drawn twice: 0.1 or 0.3 at the ends.
    assert (by_class.chamfer.low, by_class.chamfer.high) == pytest.approx((0.075, 0.175))
    assert by_class.f_by_threshold == pytest.approx(
        {"0.01": 0, "0.02": 0, "0.05": 0, "0.08": 0.5, "0.1": 0.5}
    )
    assert by_object.f_by_threshold["0.08"] == pytest.approx(1 / 3)


def test_classes():
    row = score_table(CLOUDS).rows[0]
    assert row.chamfer_by_size == pytest.approx({"large": 0.05, "small": 0.2})
    assert row.objects_by_size == {"large": 1, "small": 2}
    assert row.chamfer_by_coverage == pytest.approx({"high": 0.05, "low": 0.1})
    assert row.objects_by_coverage == {"high": 1, "low": 1}


def test_groups_keep_their_order():
    clouds = [*CLOUDS, scored(0.2, "large", "hammer", method="backprojection")]
    clouds += [scored(0.2, "large", "hammer", condition="nlos")]
    rows = [(row.method, row.condition) for row in score_table(clouds).rows]
    assert rows == 2 * [("mmnorm", "los"), ("backprojection", "los"), ("mmnorm", "nlos")]


def test_all_methods_draw_the_same_objects():
    clouds = [*CLOUDS, *(replace(cloud, method="again") for cloud in CLOUDS)]
    first, again = score_table(clouds).rows[:2]
    assert first.chamfer == again.chamfer
    assert score_table(clouds, seed=1).rows[0].chamfer.mean == first.chamfer.mean


def test_json_is_plain():
    text = json.dumps(score_table(CLOUDS).to_json(), allow_nan=False)
    read = json.loads(text)
    assert read["threshold"] == 0.08
    assert read["chamfer_variant"] == "half_sum"
    assert read["rows"][0]["mean_kind"] == "size_classes"
    assert read["paper"][0]["method"] == "Backprojection"


def test_markdown_says_what_it_shows():
    text = to_markdown(score_table(CLOUDS))
    assert "### Mean of size-class means" in text and "### Mean over objects" in text
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in lines}) == 1
    assert "| mmnorm | los | known_pose | 3 | 0.125 [0.075, 0.175] | 50 [50, 50] |" in text
    assert "0.050/–/0.200 (n 1/0/2) | 0.050/–/0.100 (n 1/0/1) |" in text
    assert text.count("| Wave-Former (paper) | all | – | – | 0.069 | 75 | 85 | 72 | – | – |") == 2


def test_what_cannot_share_a_table():
    with pytest.raises(RadarError, match="no scored clouds"):
        score_table([])
    with pytest.raises(RadarError, match="hammer occurs 2 times for mmnorm, los, known_pose"):
        score_table([*CLOUDS, CLOUDS[0]])
    with pytest.raises(RadarError, match="unknown class 'huge'"):
        score_table([replace(CLOUDS[0], size_class="huge")])
    other = replace(CLOUDS[0], score=score_reconstruction(_TRUTH.points_m, _TRUTH, threshold=0.1))
    with pytest.raises(RadarError, match="2 different metrics"):
        score_table([other, CLOUDS[1]])
