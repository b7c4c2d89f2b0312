"""What a dataset consists of: its arrays, its samples and the shards in which they are made.

Sample k lies in shard k // shard_samples. A shard is the unit of work: one worker makes all of it, and it is committed
as a whole.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import StoreError

FORMAT = "waveformer.dataset"
VERSION = 2


@dataclass(frozen=True)
class ArrayInfo:
    """One array of a dataset.

    Attributes:
        name: of the array.
        shape: of one sample.
        dtype: NumPy name, e.g. "float32".
        dimensions: one name per axis of a sample.
        unit: SI unit; None for a ratio.
    """

    name: str
    shape: tuple[int, ...]
    dtype: str
    dimensions: tuple[str, ...]
    unit: str | None = None

    def __post_init__(self) -> None:
        if len(self.shape) != len(self.dimensions) or min(self.shape, default=1) < 1:
            raise StoreError(f"array {self.name}: {self.dimensions} do not name the axes of {self.shape}")
        if np.dtype(self.dtype).kind not in "fci":
            raise StoreError(
                f"array {self.name}: {self.dtype} cannot be stored: use floats, complex or integers"
            )

    @property
    def fill_value(self) -> float | int:
        """What stands for "not made": NaN, or -1 for integers."""
        return -1 if np.dtype(self.dtype).kind == "i" else float("nan")

    @property
    def sample_bytes(self) -> int:
        """Bytes of one sample."""
        return int(np.prod(self.shape)) * np.dtype(self.dtype).itemsize

    def empty(self, count: int) -> NDArray[Any]:
        """`count` samples that were not made."""
        return np.full((count, *self.shape), self.fill_value, dtype=self.dtype)


@dataclass(frozen=True)
class DatasetLayout:
    """All that two runs on one dataset must agree on.

    Attributes:
        kind: "generate" or "propose".
        maker: "module:function" that makes a sample, see `factory_shard`.
        settings: of the maker, JSON values.
        arrays: of every sample.
        num_samples: asked for.
        shard_samples: samples made and committed together.
        tables: SHA-256 of the files beside the arrays that the maker reads, by name.
        time_limit_s, memory_limit_bytes: of one sample.
    """

    kind: str
    maker: str
    settings: Mapping[str, Any]
    arrays: tuple[ArrayInfo, ...]
    num_samples: int
    shard_samples: int
    tables: Mapping[str, str] = field(default_factory=dict)
    time_limit_s: float = 60.0
    memory_limit_bytes: int = 6 * 2**30

    def __post_init__(self) -> None:
        if self.num_samples < 1 or self.shard_samples < 1:
            raise StoreError(
                f"a dataset needs at least one sample and one a shard, got {self.num_samples} and {self.shard_samples}"
            )
        if not self.arrays:
            raise StoreError("a dataset needs at least one array")

    @property
    def num_shards(self) -> int:
        """Shards that hold all samples; the last may be shorter."""
        return -(-self.num_samples // self.shard_samples)

    def samples_of(self, shard: int) -> range:
        """Indices of the samples of a shard."""
        first = shard * self.shard_samples
        return range(first, min(first + self.shard_samples, self.num_samples))

    def to_json(self) -> dict[str, Any]:
        """JSON values."""
        values: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> DatasetLayout:
        """From `to_json`; raises KeyError or TypeError for anything else."""
        arrays = tuple(
            ArrayInfo(**{**item, "shape": tuple(item["shape"]), "dimensions": tuple(item["dimensions"])})
            for item in values["arrays"]
        )
        return cls(**{**values, "arrays": arrays})

    @property
    def sha256(self) -> str:
        """Digest that every commit record carries."""
        return digest_of(self.to_json())


def digest_of(values: Any) -> str:
    """SHA-256 of JSON values, whatever the order of their keys."""
    return hashlib.sha256(json.dumps(values, sort_keys=True, allow_nan=False).encode()).hexdigest()


def sealed(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values with their own digest, so that damage to them is found."""
    return {**values, "sha256": digest_of(dict(values))}


def unsealed(values: Mapping[str, Any]) -> dict[str, Any]:
    """What was sealed; raises ValueError if it is not what was sealed."""
    content = {key: value for key, value in values.items() if key != "sha256"}
    if values.get("sha256") != digest_of(content):
        raise ValueError("its digest differs from its content")
    return content
