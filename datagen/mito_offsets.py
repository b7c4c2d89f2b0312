"""How MITO's objects lay below its radar: the angle offsets of its objects.csv, by YCB number."""

from __future__ import annotations

import re

RotationDeg = tuple[float, float, float]

# Degrees about the fixed x, then y, then z axis. Numbers that the table leaves empty or marks with -1 are not here.
ROTATION_DEG: dict[str, RotationDeg] = {
    "002": (0, 0, 0),
    "003": (0, 90, 90),
    "004": (0, 270, 271),
    "005": (180, 0, 0),
    "006": (270, 200, 0),
    "007": (0, 180, 0),
    "008": (0, 0, 62),
    "009": (0, 0, 346),
    "010": (90, 0, 0),
    "011": (0, 180, 180),
    "012": (0, 0, 45),
    "013": (0, 0, 0),
    "014": (0, 0, 45),
    "015": (320, 330, 320),
    "016": (0, 0, 180),
    "017": (0, 180, 90),
    "018": (0, 180, 0),
    "021": (270, 0, 0),
    "022": (0, 90, 270),
    "024": (0, 0, 0),
    "025": (0, 0, 310),
    "026": (0, 180, 0),
    "027": (0, 0, 0),
    "028": (0, 0, 0),
    "029": (0, 0, 0),
    "030": (180, 0, 90),
    "031": (180, 0, 70),
    "032": (180, 0, 90),
    "033": (180, 0, 255),
    "035": (0, 0, 0),
    "037": (0, 0, 195),
    "038": (0, 0, 200),
    "040": (0, 180, 0),
    "042": (0, 0, 135),
    "043": (0, 0, 65),
    "044": (0, 0, 135),
    "048": (0, 0, 340),
    "049": (0, 0, 0),
    "050": (0, 0, 85),
    "051": (0, 0, 350),
    "052": (0, 0, 80),
    "053": (0, 0, 0),
    "054": (180, 100, 300),
    "055": (60, 120, 0),
    "057": (0, 0, 0),
    "058": (110, 0, 320),
    "061": (0, 0, 0),
    "062": (0, 0, 0),
    "065a": (0, 0, 0),
    "065b": (0, 0, 0),
    "065c": (0, 0, 0),
    "065d": (0, 0, 0),
    "065e": (0, 0, 0),
    "065f": (0, 0, 0),
    "065g": (0, 0, 0),
    "065h": (0, 0, 0),
    "065i": (0, 0, 0),
    "065j": (0, 0, 0),
    "070": (0, 0, 0),
    "071": (0, 0, 155),
    "072": (0, 0, 0),
    "077": (0, 0, 0),
}

# "035_power_drill", "065-a_cups", "065a_cups_a"
_YCB_NAME = re.compile(r"(\d{3})-?([a-z]?)(?=_|$)")


def ycb_number(object_id: str) -> str | None:
    """The YCB number that an object's name begins with, e.g. ``"065a"``; None if it has none."""
    found = _YCB_NAME.match(object_id)
    return found[1] + found[2] if found else None


def rotation_offset_deg(object_id: str) -> RotationDeg | None:
    """Turns that lay an object as MITO had it, about the fixed x, then y, then z axis; None if they are not known."""
    number = ycb_number(object_id)
    return None if number is None else ROTATION_DEG.get(number)
