"""A range-gated scan on disk: K numbers per position, and the basis that turns them back into T samples."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from waveformer.simulator.compact import CompactBasis, CompactSignal
from waveformer.simulator.errors import RadarError
from waveformer.simulator.measurement import (
    CHUNK_POSITIONS,
    Measurement,
    measurement_attributes,
    plain_metadata,
    position_arrays,
)
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.zarr_store import StoredArray, read_store, write_store

COMPACT_FORMAT = "waveformer.compact_measurement"
_SCHEMA_VERSION = 1


def save_compact(
    path: str | os.PathLike[str],
    signal: CompactSignal,
    aperture: Aperture,
    *,
    range_bias_m: float = 0.0,
    metadata: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Write a Zarr v3 store, complete or not at all.

    The basis is stored with the signal, not computed anew when reading: another version of the linear algebra
    may turn the sign of a sequence.

    Args:
        path: directory of the store.
        signal: N positions.
        aperture: N antenna pairs.
        range_bias_m, metadata: see `Measurement`.
        overwrite: replace an existing store of this format.

    Raises:
        RadarError: signal and aperture differ in length.
        StoreError: see `Measurement.save`.
    """
    if len(signal.coefficients) != len(aperture):
        raise RadarError(f"{len(signal.coefficients)} signals do not fit {len(aperture)} positions")
    basis = signal.basis
    arrays = {
        "coefficients": StoredArray(
            signal.coefficients.astype(np.complex64, copy=False),
            ("position", "coefficient"),
            (32 * CHUNK_POSITIONS, basis.num_coefficients),
        ),
        "vectors": StoredArray(basis.vectors, ("sample", "coefficient"), basis.vectors.shape),
        **position_arrays(aperture),
    }
    attributes = {
        **measurement_attributes(basis.chirp, float(range_bias_m), plain_metadata(metadata or {})),
        "nodes": basis.nodes.tolist(),
        "gate_m": [basis.near_m, basis.far_m],
        "echo_error": basis.echo_error,
    }
    write_store(path, COMPACT_FORMAT, _SCHEMA_VERSION, arrays, attributes, overwrite=overwrite)


def load_compact(path: str | os.PathLike[str]) -> tuple[CompactSignal, Aperture, dict[str, Any]]:
    """Read a store written by `save_compact`, verified.

    Returns:
        The signal, the antenna positions, and ``range_bias_m`` and ``metadata`` by name.

    Raises:
        StoreError: see `Measurement.load`.
    """
    arrays, attributes = read_store(path, COMPACT_FORMAT, _SCHEMA_VERSION)
    near_m, far_m = attributes["gate_m"]
    basis = CompactBasis(
        Chirp(**attributes["chirp"]),
        near_m,
        far_m,
        arrays["vectors"],
        np.array(attributes["nodes"], dtype=np.int64),
        attributes["echo_error"],
    )
    aperture = Aperture(arrays["tx_m"], arrays.get("rx_m"))
    rest = {name: attributes[name] for name in ("range_bias_m", "metadata")}
    return CompactSignal(arrays["coefficients"], basis), aperture, rest


def load_restored(path: str | os.PathLike[str]) -> Measurement:
    """The full measurement of a compact store, within its tolerance.

    Raises:
        StoreError: see `Measurement.load`.
    """
    signal, aperture, rest = load_compact(path)
    return Measurement(signal.basis.restore(signal.coefficients), signal.basis.chirp, aperture, **rest)
