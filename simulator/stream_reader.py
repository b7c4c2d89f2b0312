"""A stored scan, read a few rows at a time."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.measurement import MEASUREMENT_FORMAT, SCHEMA_VERSION
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.zarr_store import open_store, read_array, read_rows


class StreamReader:
    """What `Measurement.load` gives, without H in memory.

    Attributes:
        chirp: T samples.
        aperture: N antenna pairs.
        range_bias_m: see `Measurement`.
        metadata: see `Measurement`.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open a store of a measurement; all but H is read and verified.

        Raises:
            StoreError: see `Measurement.load`.
        """
        self._path = path
        self._group, attributes, digests = open_store(path, MEASUREMENT_FORMAT, SCHEMA_VERSION)
        positions = {
            name: read_array(path, self._group, name, digest)
            for name, digest in digests.items()
            if name != "h"
        }
        self.chirp = Chirp(**attributes["chirp"])
        self.aperture = Aperture(positions["tx_m"], positions.get("rx_m"))
        self.range_bias_m: float = attributes["range_bias_m"]
        self.metadata: dict[str, Any] = attributes["metadata"]

    def rows(self, rows: slice) -> NDArray[np.complex64]:
        """Rows of H, shape (rows, T), verified by the CRC-32C of each chunk of 1024.

        Raises:
            StoreError: the store is damaged.
        """
        return read_rows(self._path, self._group, "h", rows)
