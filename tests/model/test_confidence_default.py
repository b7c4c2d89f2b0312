import pytest

from waveformer.model.confidence_default import DEFAULT_CONFIDENCE
from waveformer.model.confidence_features import ConfidenceFeatures

# What a clean scan of a cracker box showed, and that of a tennis ball flooded by noise, of which 17 % lay right.
GOOD = ConfidenceFeatures(0.233, 0.717, 0.0, 0.983, 0.975, 1.0, -29.1, 0.46, 0.505, -1.145, -4.41)
BAD = ConfidenceFeatures(0.975, 0.004, 2.75, 0.004, 0.099, 0.81, -24.8, 2.69, 0.573, -1.702, -4.55)


def test_there_is_a_weight_for_every_feature():
    assert len(DEFAULT_CONFIDENCE.weights) == len(ConfidenceFeatures._fields)


def test_good_and_bad_are_told_apart():
    assert DEFAULT_CONFIDENCE.score(GOOD) > 0.8
    assert DEFAULT_CONFIDENCE.score(BAD) < 0.2  # one in five: rightly thrown away far more often than kept
    assert DEFAULT_CONFIDENCE.score(None) == 0.0


@pytest.mark.parametrize(
    ("name", "worse"),
    [
        ("level_spread", 2.5),
        ("neighbour_agreement", 0.0),
        ("depth_agreement", 0.3),
        ("normal_roughness", 4.0),
        ("column_ratio", 0.65),
    ],
)
def test_each_of_these_alone_lowers_it(name, worse):
    assert DEFAULT_CONFIDENCE.score(GOOD._replace(**{name: worse})) < DEFAULT_CONFIDENCE.score(GOOD)
