"""The arrays of a dataset as Zarr v3 with the sharding codec, so that any Zarr reader opens them.

Nothing is compressed (H and clouds shrink by less than a fifth), so that a shard can also be read with NumPy alone,
see `dataset_reader`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_files import ARRAYS_FOLDER, shard_file
from waveformer.datagen.dataset_layout import ArrayInfo, DatasetLayout
from waveformer.simulator.errors import StoreError

SAMPLE_AXIS = "sample"


def create_arrays(folder: Path, layout: DatasetLayout) -> None:
    """Create the group and its arrays, none of which has a chunk yet."""
    import zarr
    from zarr.codecs import Crc32cCodec

    group = zarr.create_group(folder, zarr_format=3)
    for info in layout.arrays:
        group.create_array(
            info.name,
            shape=(layout.num_samples, *info.shape),
            dtype=np.dtype(info.dtype),
            chunks=(1, *info.shape),
            shards=(layout.shard_samples, *info.shape),
            compressors=[Crc32cCodec()],
            fill_value=info.fill_value,
            dimension_names=(SAMPLE_AXIS, *info.dimensions),
            attributes={} if info.unit is None else {"units": info.unit},
        )


def write_rows(root: Path, info: ArrayInfo, shard: int, rows: range, block: NDArray[Any]) -> None:
    """Write all rows of a shard and read them back.

    Args:
        root: of the dataset.
        info: the array.
        shard: number.
        rows: of the shard.
        block: values, shape (len(rows), *info.shape).

    Raises:
        StoreError: what was read back differs.
        OSError: it cannot be written.
    """
    import zarr

    # What a killed run left there would be read and kept where this one has nothing.
    (root / shard_file(info.name, shard, len(info.shape))).unlink(missing_ok=True)
    array = zarr.open_array(root / ARRAYS_FOLDER / info.name, mode="r+", zarr_format=3)
    array[rows.start : rows.stop] = block
    found = np.asarray(array[rows.start : rows.stop])
    if found.tobytes() != block.tobytes():
        raise StoreError(f"{root}: shard {shard} of {info.name} was read back otherwise than it was written")
