"""The voxel grid an image is formed on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.errors import RadarError

# 8 bytes each: 16 GB.
MAX_VOXELS = 2e9


@dataclass(frozen=True, eq=False)
class Grid:
    """A rectilinear voxel grid; image value [i, j, k] belongs to (x[i], y[j], z[k]).

    Attributes:
        x, y, z: coordinates in metres in the radar frame, each 1-D and strictly increasing.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    z: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("x", "y", "z"):
            try:
                axis = np.array(getattr(self, name), dtype=np.float64)
            except (TypeError, ValueError):
                raise RadarError(f"grid axis {name} must be numbers in metres") from None
            if axis.ndim != 1 or len(axis) == 0 or not np.isfinite(axis).all():
                raise RadarError(f"grid axis {name} must be a non-empty 1-D array of finite metres")
            if (np.diff(axis) <= 0).any():
                raise RadarError(f"grid axis {name} must increase strictly")
            axis.setflags(write=False)
            object.__setattr__(self, name, axis)

    @classmethod
    def box(cls, min_m: ArrayLike, max_m: ArrayLike, spacing_m: float) -> Grid:
        """A regular grid that fills a box, both ends included where the spacing divides it.

        Args:
            min_m, max_m: opposite corners, shape (3,), metres.
            spacing_m: voxel pitch.
        """
        try:
            low, high = np.asarray(min_m, dtype=np.float64), np.asarray(max_m, dtype=np.float64)
        except (TypeError, ValueError):
            raise RadarError(f"grid box needs numbers in metres, got {min_m!r} and {max_m!r}") from None
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise RadarError(f"grid box corners must be finite, got {min_m!r} and {max_m!r}")
        if low.shape != (3,) or high.shape != (3,) or not (high >= low).all():
            raise RadarError(
                f"grid box needs min_m <= max_m, each of shape (3,), got {min_m!r} and {max_m!r}"
            )
        if not (np.isfinite(spacing_m) and spacing_m > 0):
            raise RadarError(f"grid spacing_m must be positive metres, got {spacing_m!r}")
        exact_counts = np.floor((high - low) / spacing_m + 1e-9) + 1
        if float(np.prod(exact_counts)) > MAX_VOXELS:
            shape = " x ".join(f"{count:.0f}" if count < 1e9 else f"{count:.1g}" for count in exact_counts)
            raise RadarError(f"a grid of {shape} voxels needs more than 16 GB: raise spacing_m")
        counts = exact_counts.astype(int)
        return cls(*(low[i] + np.arange(counts[i]) * spacing_m for i in range(3)))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxel counts (X, Y, Z)."""
        return len(self.x), len(self.y), len(self.z)
