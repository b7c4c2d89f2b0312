"""Receiver arrays: order of the rows, MITO's offsets, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator.arrays import RECEIVER_PRESETS, with_receivers
from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import Aperture, Chirp

GRID = Aperture.planar_grid(3, 2, 0.01)


def test_row_is_position_times_receivers_plus_receiver() -> None:
    offsets = np.array([[-0.01, 0.0, 0.0], [0.0, 0.02, 0.003]])
    pairs = with_receivers(GRID, offsets)
    assert len(pairs) == 12
    for position in range(6):
        for receiver in range(2):
            row = position * 2 + receiver
            assert (pairs.tx_m[row] == GRID.tx_m[position]).all()
            assert (pairs.receivers_m[row] == GRID.tx_m[position] + offsets[receiver]).all()


def test_mito_offsets_are_the_published_ones() -> None:
    published = np.array([-0.010802, -0.008868, -0.006934, -0.005000])
    # published to six digits after the point
    assert np.array(RECEIVER_PRESETS["mito"])[:, 0] == pytest.approx(published, abs=5e-7)
    assert not np.array(RECEIVER_PRESETS["mito"])[:, 1:].any()
    assert np.array(RECEIVER_PRESETS["mito_y"])[:, 1] == pytest.approx(published, abs=5e-7)
    spacing = np.diff(np.array(RECEIVER_PRESETS["mito"])[:, 0])
    assert spacing == pytest.approx(Chirp.from_preset("mito").wavelengths_m[0] / 2, rel=1e-12)


def test_a_preset_can_be_asked_for_by_name() -> None:
    named, given = with_receivers(GRID, "mito"), with_receivers(GRID, RECEIVER_PRESETS["mito"])
    assert (named.receivers_m == given.receivers_m).all()


@pytest.mark.parametrize("offsets", [[0.0, 0.0, 0.0], [[0.0, 0.0]], [], [[0, 0, np.nan]], "x y"])
def test_wrong_offsets_are_refused(offsets: Any) -> None:
    with pytest.raises(RadarError):
        with_receivers(GRID, offsets)


def test_an_unknown_preset_names_the_known_ones_and_pairs_are_not_paired_again() -> None:
    with pytest.raises(RadarError, match="mito"):
        with_receivers(GRID, "mitto")
    with pytest.raises(RadarError, match="has receivers"):
        with_receivers(with_receivers(GRID, "mito"), "mito")
