"""What the differentiable model refuses: in one line that names the argument."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from waveformer.simulator import primitives
from waveformer.simulator.differentiable import Box, Sheet, freeze, simulate, simulate_drjit
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.radar import Aperture, Chirp

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

BALL = primitives.sphere(0.008, 0.003)
VERTICES, FACES = np.array(BALL.vertices) - [0.0, 0.0, 0.4], np.array(BALL.faces)
FEW = Aperture.planar_grid(2, 2, 0.03).tx_m
SCENE: dict[str, Any] = {"vertices": VERTICES, "faces": FACES, "chirp": Chirp(77e9, 3.6e9, 11), "tx_m": FEW}
LAST = len(VERTICES) - 1
ONCE_NAN = np.where(np.arange(LAST + 1)[:, None] == 5, np.nan, VERTICES)
PLACE = ((0, 0, -0.1), (0, 0, 1))


# What both freezing and simulating need.
GEOMETRY: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"vertices": VERTICES[:, :2]}, RadarError, r"vertices must be real numbers of shape \(n, 3\) with n >= 1, got f"),
    ({"vertices": VERTICES[:0]}, RadarError, r"vertices must be real numbers of shape \(n, 3\) with n >= 1, got f"),
    ({"vertices": VERTICES + 0j}, RadarError, r"vertices must be real numbers .* got complex128 of shape"),
    ({"vertices": torch.from_numpy(VERTICES + 0j)}, RadarError, "vertices must be real numbers .* got torch.complex128"),
    ({"vertices": "ball.ply"}, RadarError, r"vertices must be real numbers .* got 'ball.ply'"),
    ({"vertices": [[0, 0, 0], [1, 2]]}, RadarError, r"vertices must be real numbers .* got \[\[0, 0, 0\], \[1, 2\]\]"),
    ({"vertices": ONCE_NAN}, RadarError, f"vertices must be finite: 1 of {LAST + 1} rows hold NaN or infinity"),
    ({"faces": FACES[:0]}, RadarError, r"faces must be real numbers of shape \(n, 3\) with n >= 1"),
    ({"faces": "ball.ply"}, RadarError, r"faces must be real numbers .* got 'ball.ply'"),
    ({"faces": [[0, 1, 2], [1, 2]]}, RadarError, "faces must be real numbers"),
    ({"faces": FACES + 0.5}, MeshError, f"faces must be whole numbers from 0 to {LAST}, the rows of vertices, got"),
    ({"faces": FACES + len(VERTICES)}, MeshError, "faces must be whole numbers from 0 to"),
    ({"faces": np.concatenate([FACES, FACES[:3]])}, MeshError, "3 faces repeat others or are their backs: give each once"),
    ({"faces": np.concatenate([FACES, FACES[:2, ::-1]])}, MeshError, "2 faces repeat others or are their backs"),
    ({"tx_m": FEW[0]}, RadarError, "tx_m must be real numbers of shape"),
    ({"tx_m": [["a", "b", "c"]]}, RadarError, "tx_m must be real numbers of shape"),
    ({"tx_m": FEW + np.inf}, RadarError, "tx_m must be finite: 4 of 4 rows"),
    ({"rx_m": FEW[:2]}, RadarError, "aperture rx_m .* must pair row by row"),
    ({"vertices": VERTICES + [0, 0, 0.5]}, MeshError, ".*lies behind"),
    ({"vertices": VERTICES - [0, 0, 0.3]}, RadarError, ".*unambiguous range"),
    ({"chirp": None}, RadarError, "chirp must be a Chirp, got None"),
    ({"mode": "slow"}, RadarError, "mode of the differentiable model must be"),
    ({"mode": np.ones(3)}, RadarError, "mode of the differentiable model must be .* got float64 of shape"),
    ({"sheets": None}, RadarError, "sheets must be Sheet objects, got None"),
    ({"sheets": [1]}, RadarError, "sheets must be Sheet objects, got 1"),
    ({"sheets": "glass"}, RadarError, "sheets must be Sheet objects, got 'glass'"),
    ({"sheets": Sheet(*PLACE, torch.ones(2), "abs")}, RadarError, "sheet thickness_m must be one real number"),
    ({"sheets": Sheet(*PLACE, 0.003, [2.0])}, RadarError, "permittivity must be one number"),
    ({"box": "glass"}, RadarError, "box must be a Box or None, got 'glass'"),
    ({"box": Box((-0.1,) * 3, (0.1,) * 3, "thin", 2.0)}, RadarError, "box thickness_m must be one real number"),
    ({"antenna": "dish"}, RadarError, "antenna must be an Antenna"),
]  # fmt: skip
NUMBERS: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"frozen": "x"}, RadarError, "frozen must be a FrozenScene, got 'x'"),
    ({"permittivity": torch.tensor([3.0, 2.0])}, RadarError, "permittivity must be one number, finite, got torch.float32"),
    ({"permittivity": torch.tensor([3.0, 2.0], requires_grad=True)}, RadarError, "permittivity must be one number"),
    ({"permittivity": [3.0]}, RadarError, r"permittivity must be one number, finite, got \[3.0\]"),
    ({"permittivity": "cheese"}, RadarError, "unknown material 'cheese'"),
    ({"roughness_m": torch.tensor([1e-4, 1e-4])}, RadarError, "roughness_m must be one real number"),
    ({"roughness_m": torch.tensor(1e-4j)}, RadarError, "roughness_m must be one real number"),
    ({"roughness_m": None}, RadarError, "roughness_m must be one real number, finite, got None"),
    ({"thickness_m": 0.003}, RadarError, "thickness_m needs a permittivity"),
    ({"thickness_m": "thin", "permittivity": 3.0}, RadarError, "thickness_m must be one real number, finite, got 'thin'"),
    ({"reflectivity": torch.ones(2)}, RadarError, "reflectivity must be one number"),
    ({"reflectivity": None}, RadarError, "reflectivity must be one number, finite, got None"),
    ({"reflectivity": "x"}, RadarError, "reflectivity must be one number, finite, got 'x'"),
    ({"reflectivity": np.nan}, RadarError, "reflectivity must be one number, finite, got nan"),
    ({"reflectivity": True}, RadarError, "reflectivity must be one number"),
    ({"antenna_gain_db": np.nan}, RadarError, "antenna_gain_db must be one real number, finite, got nan"),
    ({"antenna_gain_db": torch.tensor(np.inf)}, RadarError, "antenna_gain_db must be one real number, finite, got tensor"),
    ({"range_bias_m": np.nan}, RadarError, "range_bias_m must be one real number, finite, got nan"),
    ({"range_bias_m": 1e-3j}, RadarError, "range_bias_m must be one real number, finite, got 0.001j"),
    ({"range_bias_m": torch.tensor(1e-3j)}, RadarError, "range_bias_m must be one real number"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("call", "changes", "error", "message"),
    [(freeze, *case) for case in GEOMETRY] + [(simulate, *case) for case in [*GEOMETRY, *NUMBERS]],
)
def test_what_makes_no_sense_is_refused(
    call: Any, changes: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=f"^{message}") as caught:
        call(**(SCENE | changes))
    assert "\n" not in str(caught.value)


def test_drjit_numbers_are_real_scalars() -> None:
    from drjit.auto.ad import Complex2f, Float, TensorXf

    rest = {"faces": FACES, "chirp": SCENE["chirp"]}
    places = TensorXf(VERTICES.astype(np.float32)), TensorXf(FEW.astype(np.float32))
    for name, value in (
        ("permittivity", Complex2f(3.0, -0.2)), ("reflectivity", Float(1.0, 2.0)), ("range_bias_m", Complex2f(0.0)),
    ):  # fmt: skip
        with pytest.raises(RadarError, match=f"^{name} must be a real scalar of Dr.Jit") as caught:
            simulate_drjit(places[0], tx_m=places[1], **rest, **{name: value})
        assert "\n" not in str(caught.value)
    sheet = Sheet(*PLACE, Float(0.003), 2.0)
    with pytest.raises(RadarError, match=r"^sheet thickness_m must be one real number"):
        simulate_drjit(places[0], tx_m=places[1], sheets=sheet, **rest)
