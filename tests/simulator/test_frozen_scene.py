"""A frozen scene serves the scene that it was made for, and no other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from waveformer.simulator import primitives
from waveformer.simulator.differentiable import Box, freeze, simulate
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.radar import Aperture, Chirp

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

BALL = primitives.sphere(0.008, 0.003)
FEW = Aperture.planar_grid(2, 2, 0.03).tx_m
SCENE: dict[str, Any] = {
    "vertices": np.array(BALL.vertices) - [0.0, 0.0, 0.4],
    "faces": np.array(BALL.faces),
    "chirp": Chirp(77e9, 3.6e9, 11),
    "tx_m": FEW,
}
FACES, CHIRP = SCENE["faces"], SCENE["chirp"]


@pytest.mark.parametrize(
    "other",
    [
        {"tx_m": Aperture.planar_grid(3, 3, 0.01).tx_m},
        {"rx_m": FEW + 0.01},
        {"chirp": replace(CHIRP, num_samples=16)},
        {"vertices": SCENE["vertices"][:100]},
        {"faces": FACES[:100]},
        {"faces": FACES * 0},
        {"faces": np.roll(FACES, 1, axis=0)},
        {"box": Box((-0.05, -0.05, -0.45), (0.05, 0.05, -0.35), 0.003, 2.0)},
    ],
    ids=["antennas", "receivers", "chirp", "vertices", "fewer faces", "no faces", "order of faces", "box"],
)
def test_that_of_another_scene_is_refused(other: dict[str, Any]) -> None:
    with pytest.raises((RadarError, MeshError), match="freeze the scene anew") as caught:
        simulate(**(SCENE | other), frozen=freeze(**SCENE))
    assert "\n" not in str(caught.value)


def test_numbers_may_be_tensors_of_any_kind() -> None:
    frozen = freeze(
        **{name: value if name == "chirp" else torch.tensor(value) for name, value in SCENE.items()}
    )
    assert frozen.num_samples > 0
    h = simulate(**SCENE, frozen=frozen)
    again = simulate(**(SCENE | {"faces": torch.tensor(FACES), "tx_m": FEW.tolist()}), frozen=frozen)
    assert torch.equal(h, again)


def test_faces_without_area_are_left_out() -> None:
    line = [[FACES[0, 0], FACES[0, 0], FACES[0, 1]]]
    frozen = freeze(**(SCENE | {"faces": np.concatenate([FACES, line])}))
    assert len(frozen.faces) == len(FACES)
