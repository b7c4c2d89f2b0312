"""Export to tar files in the convention of webdataset: <key>.<array>.npy and <key>.json follow each other."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from waveformer.datagen.export_choice import ExportChoice
from waveformer.datagen.export_folder import collected
from waveformer.simulator.storage import publish_file

# A few hundred megabytes: few files, and still enough of them to share out among workers.
SHARD_BYTES = 256 * 2**20


def export_webdataset(
    choice: ExportChoice,
    out: Path,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
    shard_bytes: int = SHARD_BYTES,
) -> None:
    """Write OUT/samples/shard-<number>.tar; an interrupted export goes on with the next tar file.

    Args:
        choice: what is exported.
        out: folder, see `export_folder`.
        overwrite: replace an export.
        progress: called with (samples done, samples).
        shard_bytes: aimed at for each tar file.

    Raises:
        StoreError: the dataset is damaged, or `out` cannot be written.
    """
    count = max(1, shard_bytes // choice.sample_bytes)
    settings = {"layout": "webdataset", "shard_samples": count}
    with collected(out, choice, settings, overwrite=overwrite) as folder:
        for number, start in enumerate(range(0, len(choice), count)):
            path = folder / f"shard-{number:06d}.tar"
            indices = choice.indices[start : start + count].tolist()
            if not path.exists():
                with publish_file(path) as temporary, tarfile.open(temporary, "w") as tar:
                    for index in indices:
                        _add_sample(tar, choice, index)
            if progress is not None:
                progress(start + len(indices), len(choice))


def _add_sample(tar: tarfile.TarFile, choice: ExportChoice, index: int) -> None:
    key = f"{index:08d}"
    for name, values in choice.data.read(index, choice.names).items():
        content = io.BytesIO()
        np.save(content, values, allow_pickle=False)
        _add(tar, f"{key}.{name}.npy", content.getvalue())
    _add(tar, f"{key}.json", choice.record_json(index).encode())


def _add(tar: tarfile.TarFile, name: str, content: bytes) -> None:
    # No time and no owner: the same samples make the same bytes.
    member = tarfile.TarInfo(name)
    member.size = len(content)
    tar.addfile(member, io.BytesIO(content))
