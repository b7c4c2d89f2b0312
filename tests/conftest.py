"""Fixtures that every test may use."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def mitsuba_variant() -> str:
    """The variant the simulator uses, started with one thread, so that results repeat bit by bit."""
    from waveformer.simulator.runtime import VARIANTS, activate, chosen_device

    activate(num_threads=1)
    return VARIANTS[chosen_device()]


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Random numbers that depend on the name of the test only, not on the order of the tests."""
    return np.random.default_rng(zlib.crc32(request.node.name.encode()))


@pytest.fixture(scope="session")
def shared_meshes() -> Path:
    """Folder of the shared mesh collection, which lies beside the repository and is not part of it."""
    folder = REPOSITORY.parent / "shared" / "meshes"
    if not (folder / "INDEX.csv").is_file():
        pytest.skip(f"the shared mesh collection is not at {folder}")
    return folder
