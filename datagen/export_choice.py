"""What is exported, and how an export describes itself to programs that know nothing of waveformer."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer import __version__
from waveformer.datagen.dataset_layout import ArrayInfo
from waveformer.datagen.dataset_reader import Dataset
from waveformer.datagen.dataset_selection import known_names, select_samples

EXPORT_FORMAT = "waveformer.export"
EXPORT_VERSION = 1
SIGNAL = "h"


@dataclass(frozen=True, eq=False)
class ExportChoice:
    """Committed samples of a dataset, and which of their arrays; made by `choose`.

    Attributes:
        data: the dataset.
        indices: of the samples, ascending, shape (n,).
        names: of the arrays.
    """

    data: Dataset
    indices: NDArray[np.int64]
    names: tuple[str, ...]

    @classmethod
    def choose(
        cls,
        data: Dataset,
        *,
        names: Collection[str] | None = None,
        splits: Collection[str] | None = None,
        limit: int | None = None,
    ) -> ExportChoice:
        """Choose arrays and samples; None means all. Raises StoreError for what the dataset does not have."""
        return cls(data, select_samples(data, splits=splits, limit=limit), known_names(data, names))

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def arrays(self) -> tuple[ArrayInfo, ...]:
        """The arrays chosen."""
        return tuple(self.data.arrays[name] for name in self.names)

    @property
    def sample_bytes(self) -> int:
        """Of the arrays of one sample."""
        return sum(info.sample_bytes for info in self.arrays)

    def samples(self) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
        """Index and arrays of every sample; raises StoreError for a damaged one."""
        for index in self.indices.tolist():
            yield index, self.data.read(index, self.names)

    def record_json(self, index: int) -> str:
        """What is known about a sample, as JSON text."""
        return json.dumps({"index": index, **self.data.record(index)}, sort_keys=True)

    def describe(self) -> dict[str, Any]:
        """The whole export as JSON values: arrays with dimensions and SI units, settings and versions behind them."""
        layout = self.data.layout
        values = {
            "format": EXPORT_FORMAT,
            "version": EXPORT_VERSION,
            "waveformer": __version__,
            "num_samples": len(self),
            "samples_sha256": hashlib.sha256(self.indices.astype("<i8").tobytes()).hexdigest(),
            "arrays": {info.name: asdict(info) for info in self.arrays},
            "dataset": {
                "kind": layout.kind,
                "layout_sha256": layout.sha256,
                "settings": layout.settings,
                "provenance": self.data.provenance,
            },
        }
        described: dict[str, Any] = json.loads(json.dumps(values))
        return described

    def radar(self) -> dict[str, NDArray[np.float64]]:
        """Frequencies (T,) and antenna positions (N, 3) of the signals; empty where no signal is exported."""
        chirp, aperture = self.data.chirp, self.data.aperture
        if SIGNAL not in self.names or chirp is None or aperture is None:
            return {}
        return {
            "frequencies_hz": chirp.frequencies_hz,
            "tx_m": aperture.tx_m,
            "rx_m": aperture.receivers_m,
        }
