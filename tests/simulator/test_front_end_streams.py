"""Random rows do not depend on the block that asks for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end_streams import CHUNK_ROWS, draw_rows, generator


def rows(seed: int, purpose: str, first: int, stop: int) -> np.ndarray:
    return draw_rows(seed, purpose, first, stop, lambda rng, count: rng.standard_normal((count, 3)))


def test_any_cut_into_blocks_gives_the_same_rows() -> None:
    whole = rows(0, "noise", 0, 3 * CHUNK_ROWS + 7)
    assert whole.shape == (3 * CHUNK_ROWS + 7, 3)
    for first, stop in [
        (0, 1),
        (5, CHUNK_ROWS),
        (CHUNK_ROWS - 1, CHUNK_ROWS + 1),
        (300, 700),
        (700, len(whole)),
    ]:
        assert (rows(0, "noise", first, stop) == whole[first:stop]).all()


def test_seeds_purposes_and_chunks_have_numbers_of_their_own() -> None:
    reference = rows(0, "noise", 0, CHUNK_ROWS)
    for other in (
        rows(1, "noise", 0, CHUNK_ROWS),
        rows(0, "phase", 0, CHUNK_ROWS),
        rows(0, "noise", CHUNK_ROWS, 2 * CHUNK_ROWS),
    ):
        # 768 pairs of independent numbers correlate by 0.036 (one standard deviation)
        assert abs(np.corrcoef(reference.ravel(), other.ravel())[0, 1]) < 0.16


@pytest.mark.parametrize("seed", [-1, 0.5, True, None])
def test_only_whole_seeds_of_at_least_zero(seed: Any) -> None:
    with pytest.raises(RadarError, match="seed"):
        generator(seed, "noise")
