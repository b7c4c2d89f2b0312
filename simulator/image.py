"""A complex voxel image and its grid."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import plain_metadata
from waveformer.simulator.zarr_store import StoredArray, read_store, write_store

IMAGE_FORMAT = "waveformer.image"
_SCHEMA_VERSION = 1
_CHUNK_VOXELS = 64


@dataclass(frozen=True, eq=False)
class Image:
    """A backprojected image.

    Attributes:
        values: shape (X, Y, Z) complex64; values[i, j, k] belongs to (grid.x[i], grid.y[j], grid.z[k]).
        grid: voxel coordinates, metres, radar frame.
        metadata: how the image came about; plain JSON values.
    """

    values: NDArray[np.complex64]
    grid: Grid
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = np.asarray(self.values)
        if values.shape != self.grid.shape:
            raise RadarError(f"image values must have the grid's shape {self.grid.shape}, got {values.shape}")
        if not np.iscomplexobj(values):
            raise RadarError(f"image values must be complex, got {values.dtype}")
        values = values.astype(np.complex64)
        values.setflags(write=False)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "metadata", plain_metadata(self.metadata))

    @property
    def peak_position_m(self) -> NDArray[np.float64]:
        """Voxel of the greatest magnitude, shape (3,), metres."""
        index = np.unravel_index(int(np.argmax(np.abs(self.values))), self.grid.shape)
        return np.array(
            [axis[i] for axis, i in zip((self.grid.x, self.grid.y, self.grid.z), index, strict=True)]
        )

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write a Zarr v3 store, complete or not at all.

        Raises:
            StoreError: `path` exists and overwrite is False, is something else, or cannot be written.
        """
        arrays = {"values": StoredArray(self.values, ("x", "y", "z"), (_CHUNK_VOXELS,) * 3)}
        for name in ("x", "y", "z"):
            axis = getattr(self.grid, name)
            arrays[name] = StoredArray(axis, (name,), axis.shape, unit="m")
        write_store(
            path, IMAGE_FORMAT, _SCHEMA_VERSION, arrays, {"metadata": self.metadata}, overwrite=overwrite
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Image:
        """Read a store written by `save`; its numbers are verified against their checksums.

        Raises:
            StoreError: missing, not an image, from a newer waveformer, or damaged.
        """
        arrays, attributes = read_store(path, IMAGE_FORMAT, _SCHEMA_VERSION)
        return cls(arrays["values"], Grid(arrays["x"], arrays["y"], arrays["z"]), attributes["metadata"])
