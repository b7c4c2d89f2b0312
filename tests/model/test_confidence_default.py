import math

import pytest

from waveformer.model.confidence_default import DEFAULT_CONFIDENCE
from waveformer.model.confidence_features import ConfidenceFeatures

# What a clean scan of a box showed, and what one flooded by noise did.
GOOD = ConfidenceFeatures(0.1, 0.9, 0.0, 0.95, 0.9, 1.0, -38.0, 1.0, 0.50, math.log(0.2), math.log(0.02))
BAD = ConfidenceFeatures(2.0, 0.05, 2.7, 0.02, 0.08, 0.7, -17.0, 2.8, 0.60, math.log(0.2), math.log(0.2))


def test_there_is_a_weight_for_every_feature():
    assert len(DEFAULT_CONFIDENCE.weights) == len(ConfidenceFeatures._fields)


def test_good_and_bad_are_told_apart():
    assert DEFAULT_CONFIDENCE.score(GOOD) > 0.8
    assert DEFAULT_CONFIDENCE.score(BAD) < 0.1
    assert DEFAULT_CONFIDENCE.score(None) == 0.0


@pytest.mark.parametrize(
    ("name", "worse"),
    [
        ("level_spread", 2.5),
        ("neighbour_agreement", 0.0),
        ("image_floor_db", -10.0),
        ("normal_roughness", 4.0),
    ],
)
def test_each_of_these_alone_lowers_it(name, worse):
    assert DEFAULT_CONFIDENCE.score(GOOD._replace(**{name: worse})) < DEFAULT_CONFIDENCE.score(GOOD)
