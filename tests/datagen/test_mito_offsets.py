"""The table of MITO's angle offsets and the names that lead to it."""

import pytest

from waveformer.datagen.mito_offsets import ROTATION_DEG, rotation_offset_deg, ycb_number


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("035_power_drill", "035"),
        ("065a_cups_a", "065a"),
        ("065-a_cups", "065a"),
        ("005", "005"),
        ("0351_power_drill", None),
        ("power_drill", None),
        ("", None),
    ],
)
def test_ycb_number(name, number):
    assert ycb_number(name) == number


def test_offsets_of_some_objects():
    assert rotation_offset_deg("006_mustard_bottle") == (270, 200, 0)
    assert rotation_offset_deg("042_adjustable_wrench") == (0, 0, 135)
    assert rotation_offset_deg("065j_cups_j") == (0, 0, 0)


def test_unknown_offsets_are_none():
    # -1 in the table, empty in the table, no YCB object
    for name in ("001_chips_can", "056_tennis_ball", "mug"):
        assert rotation_offset_deg(name) is None


def test_all_offsets_are_turns():
    assert len(ROTATION_DEG) == 62  # 72 rows, 6 of them with -1 and 4 empty
    assert all(0 <= angle < 360 for angles in ROTATION_DEG.values() for angle in angles)
