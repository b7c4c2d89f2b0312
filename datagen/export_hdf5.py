"""Export to HDF5: one file, one dataset an array, samples along the first axis."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from waveformer.datagen.dataset_zarr import SAMPLE_AXIS
from waveformer.datagen.export_choice import SIGNAL, ExportChoice
from waveformer.simulator.storage import publish_file

_RADAR_UNITS = {"frequencies_hz": "Hz", "tx_m": "m", "rx_m": "m"}


def export_hdf5(
    choice: ExportChoice,
    out: Path,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write one HDF5 file.

    Every dataset has named dimensions, a chunk and a Fletcher-32 checksum a sample, and its unit as the attribute
    `units`. Beside the arrays lie `sample_index` (a dimension scale), `record` (JSON text a sample), and of signals
    `frequencies_hz` (a dimension scale), `tx_m`, `rx_m`. The attribute `description` is the export's description.

    Args:
        choice: what is exported.
        out: the file; an interrupted export leaves none.
        overwrite: replace a file.
        progress: called with (samples done, samples).

    Raises:
        StoreError: the dataset is damaged, or `out` cannot be written.
    """
    import h5py

    with publish_file(out, overwrite=overwrite) as path, h5py.File(path, "w") as file:
        file.attrs["description"] = json.dumps(choice.describe(), sort_keys=True)
        index = file.create_dataset("sample_index", data=choice.indices)
        index.make_scale(SAMPLE_AXIS)
        _write_radar(file, choice)
        for info in choice.arrays:
            found = file.create_dataset(
                info.name,
                (len(choice), *info.shape),
                np.dtype(info.dtype),
                chunks=(1, *info.shape),
                fletcher32=True,
            )
            for axis, name in enumerate((SAMPLE_AXIS, *info.dimensions)):
                found.dims[axis].label = name
            found.dims[0].attach_scale(index)
            if info.unit is not None:
                found.attrs["units"] = info.unit
            if info.name == SIGNAL and "frequencies_hz" in file:
                found.dims[2].attach_scale(file["frequencies_hz"])
        records = file.create_dataset("record", (len(choice),), h5py.string_dtype())
        for row, (sample, arrays) in enumerate(choice.samples()):
            for name, values in arrays.items():
                file[name][row] = values
            records[row] = choice.record_json(sample)
            if progress is not None:
                progress(row + 1, len(choice))


def _write_radar(file: Any, choice: ExportChoice) -> None:
    for name, values in choice.radar().items():
        file.create_dataset(name, data=values).attrs["units"] = _RADAR_UNITS[name]
    if "frequencies_hz" in file:
        file["frequencies_hz"].make_scale("chirp_sample")
