"""Random numbers that belong to a row, whatever block of rows asks for them."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError

# Rows that share one generator. A block that covers part of a chunk draws the whole chunk and keeps its part.
CHUNK_ROWS = 256

Draw = Callable[[np.random.Generator, int], NDArray[Any]]


def generator(seed: int, purpose: str, chunk: int = 0) -> np.random.Generator:
    """The generator of one chunk of rows for one purpose; different purposes never share numbers.

    Raises:
        RadarError: the seed is not a whole number of at least 0.
    """
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)) or seed < 0:
        raise RadarError(f"seed must be a whole number of at least 0, got {seed!r}")
    return np.random.default_rng([int(seed), zlib.crc32(purpose.encode()), chunk])


def draw_rows(seed: int, purpose: str, first: int, stop: int, draw: Draw) -> NDArray[Any]:
    """Random rows first .. stop - 1, the same for every way to cut all rows into blocks.

    Args:
        seed: of the simulation.
        purpose: names the stream.
        first, stop: rows wanted.
        draw: draws a number of rows from a generator; its first axis counts them.

    Returns:
        The rows, shape (stop - first, ...).
    """
    parts = []
    for chunk in range(first // CHUNK_ROWS, (stop - 1) // CHUNK_ROWS + 1):
        start = chunk * CHUNK_ROWS
        rows = draw(generator(seed, purpose, chunk), CHUNK_ROWS)
        parts.append(rows[max(first - start, 0) : stop - start])
    return np.concatenate(parts)
