"""What callers pass is taken in every form that holds it, and shown in one short line."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import torch

from waveformer.simulator.arguments import (
    complex_number,
    constant,
    coordinates,
    real_number,
    shown,
    triangles,
)
from waveformer.simulator.errors import MeshError, RadarError


@pytest.mark.parametrize(
    "value",
    [[[1, 2, 3]], ((1.0, 2.0, 3.0),), np.array([[1, 2, 3]], np.float32), torch.tensor([[1.0, 2.0, 3.0]], requires_grad=True)],
)  # fmt: skip
def test_coordinates_come_in_many_forms(value: Any) -> None:
    array = coordinates("tx_m", value)
    assert array.dtype == np.float64
    assert array.tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize(
    "value", [2, 2.0, np.float32(2), np.array([2]), torch.tensor(2.0), torch.tensor([2.0])]
)
def test_numbers_come_in_many_forms(value: Any) -> None:
    assert real_number("gain", value) == 2.0
    assert complex_number("gain", value) == 2.0


@pytest.mark.parametrize(
    "value", [2j, np.complex64(2), torch.tensor(2.0).conj() * 1j, "2", None, [2.0], True, np.inf]
)
def test_what_is_no_real_number_is_refused(value: Any) -> None:
    with pytest.raises(RadarError, match=r"^gain must be one real number, finite, got "):
        real_number("gain", value)


def test_conjugate_views_count_as_what_they_stand_for() -> None:
    assert complex_number("permittivity", torch.tensor(3 + 0.2j).conj()) == pytest.approx(3 - 0.2j)


def test_a_constant_keeps_its_value_and_loses_no_derivative() -> None:
    assert constant("tx_m", 3.0) == 3.0
    assert constant("tx_m", torch.ones(2)).tolist() == [1.0, 1.0]
    with pytest.raises(RadarError, match=r"^tx_m requires a gradient.*pass tx_m\.detach\(\)$"):
        constant("tx_m", torch.ones(2, requires_grad=True))


def test_faces_name_vertices() -> None:
    corners, faces = triangles(np.eye(3), [[0.0, 1.0, 2.0]])
    assert faces.dtype == np.int64
    with pytest.raises(MeshError, match="from 0 to 2, the rows of vertices, got 1 to 3"):
        triangles(corners, [[1, 2, 3]])


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.zeros((3, 4)), "float64 of shape (3, 4)"),
        (torch.zeros(2, dtype=torch.int64), "torch.int64 of shape (2,)"),
        (None, "None"),
        (list(range(100)), "[0, 1, 2, 3, 4, 5, ...]"),
    ],
)
def test_values_are_shown_in_a_few_words(value: Any, text: str) -> None:
    assert shown(value) == text
    assert len(shown("many words " * 100)) < 70


def test_torch_is_loaded_only_for_tensors() -> None:
    code = (
        "import sys; from waveformer.simulator.arguments import constant, coordinates, real_number;"
        "constant('a', 1.0), coordinates('a', [[1, 2, 3]]), real_number('a', 1.0); assert 'torch' not in sys.modules"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
