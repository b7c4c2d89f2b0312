"""What a radar recorded: H, where, with which chirp."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.errors import RadarError, StoreError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.zarr_store import StoredArray, read_store, write_store

MEASUREMENT_FORMAT = "waveformer.measurement"
SCHEMA_VERSION = 1
CHUNK_POSITIONS = 1024
H_DIMENSIONS = ("position", "sample")


@dataclass(frozen=True, eq=False)
class Measurement:
    """A raw FMCW scan.

    Attributes:
        h: dechirped samples, shape (N, T) complex64; ``|h|^2`` = received over transmitted power.
        chirp: T samples of one frequency sweep.
        aperture: N antenna positions, metres, radar frame.
        range_bias_m: known bias of the round-trip path, which imaging takes out.
        metadata: how the scan came about; plain JSON values.
    """

    h: NDArray[np.complex64]
    chirp: Chirp
    aperture: Aperture
    range_bias_m: float = 0.0
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        h = np.asarray(self.h)
        expected = (len(self.aperture), self.chirp.num_samples)
        if h.shape != expected:
            raise RadarError(f"h must have shape (positions, samples) = {expected}, got {h.shape}")
        if not np.iscomplexobj(h):
            raise RadarError(f"h must be complex, got {h.dtype}")
        if not np.isfinite(self.range_bias_m):
            raise RadarError(f"range_bias_m must be finite metres, got {self.range_bias_m!r}")
        h = h.astype(np.complex64)
        h.setflags(write=False)
        object.__setattr__(self, "h", h)
        object.__setattr__(self, "range_bias_m", float(self.range_bias_m))
        object.__setattr__(self, "metadata", plain_metadata(self.metadata))

    @property
    def bias_correction(self) -> NDArray[np.complex128]:
        """Factor on every sample that takes the known range bias out of h, shape (T,)."""
        turns = self.chirp.frequencies_hz * (self.range_bias_m / SPEED_OF_LIGHT_M_PER_S)
        return np.asarray(np.exp(2j * np.pi * turns))

    def range_profile(self, oversampling: int = 4) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Magnitude over range, without a window: an echo ``a * exp(-j 2 pi f tau)`` peaks at ``|a|``.

        Args:
            oversampling: profile points per range bin (zero padding).

        Returns:
            Range in metres, shape (K,) with K = oversampling * T, from the first bin up to the unambiguous
            range and less half the range bias; and the magnitude of every position, shape (N, K).
        """
        num_points = oversampling * self.chirp.num_samples
        range_m = np.arange(num_points) * self.chirp.range_bin_m / oversampling - self.range_bias_m / 2
        magnitude = np.empty((len(self.h), num_points), np.float32)
        for start in range(0, len(self.h), CHUNK_POSITIONS):
            block = slice(start, start + CHUNK_POSITIONS)
            # ifft has the + sign that undoes exp(-j 2 pi f_t tau), and divides by its length.
            magnitude[block] = np.abs(np.fft.ifft(self.h[block], n=num_points, axis=1)) * oversampling
        return range_m, magnitude

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write a Zarr v3 store, complete or not at all.

        Raises:
            StoreError: `path` exists and overwrite is False, is something else, or cannot be written.
        """
        arrays = {
            "h": StoredArray(self.h, H_DIMENSIONS, (CHUNK_POSITIONS, self.chirp.num_samples)),
            **position_arrays(self.aperture),
        }
        attributes = measurement_attributes(self.chirp, self.range_bias_m, self.metadata)
        write_store(path, MEASUREMENT_FORMAT, SCHEMA_VERSION, arrays, attributes, overwrite=overwrite)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Measurement:
        """Read a store written by `save`; its numbers are verified against their checksums.

        Raises:
            StoreError: missing, not a measurement, from a newer waveformer, or damaged.
        """
        arrays, attributes = read_store(path, MEASUREMENT_FORMAT, SCHEMA_VERSION)
        return cls(
            h=arrays["h"],
            chirp=Chirp(**attributes["chirp"]),
            aperture=Aperture(arrays["tx_m"], arrays.get("rx_m")),
            range_bias_m=attributes["range_bias_m"],
            metadata=attributes["metadata"],
        )


def position_arrays(aperture: Aperture) -> dict[str, StoredArray]:
    """Antenna positions as a store keeps them."""
    positions = {"tx_m": aperture.tx_m}
    if aperture.rx_m is not None:
        positions["rx_m"] = aperture.rx_m
    return {
        name: StoredArray(values, ("position", "axis"), values.shape, unit="m")
        for name, values in positions.items()
    }


def measurement_attributes(chirp: Chirp, range_bias_m: float, metadata: Mapping[str, Any]) -> dict[str, Any]:
    """What a store of a measurement says besides its arrays."""
    return {
        "chirp": {name: _number(value) for name, value in dataclasses.asdict(chirp).items()},
        "range_bias_m": range_bias_m,
        "metadata": metadata,
    }


def plain_metadata(metadata: Mapping[str, Any]) -> dict[str, Any]:
    """A copy made of JSON values only, so that what is loaded later equals what is in memory now.

    NumPy numbers and arrays become numbers and lists, paths become strings.

    Raises:
        StoreError: a value is not JSON, or not finite.
    """

    def plain(value: Any) -> Any:
        if isinstance(value, (np.generic, np.ndarray)):
            return value.tolist()
        if isinstance(value, os.PathLike):
            return os.fspath(value)
        raise TypeError(f"{type(value).__name__} is not a JSON value")

    try:
        copy: dict[str, Any] = json.loads(json.dumps(dict(metadata), default=plain, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise StoreError(f"metadata must hold JSON values only: {error}") from error
    return copy


def _number(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
