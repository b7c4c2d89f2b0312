"""Export to NumPy: one NPZ file a sample, with its record as JSON text in the array `record`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from waveformer.datagen.export_choice import ExportChoice
from waveformer.datagen.export_folder import collected
from waveformer.simulator.storage import publish_file


def export_npz(
    choice: ExportChoice,
    out: Path,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write OUT/samples/<index>.npz; an interrupted export goes on.

    Args:
        choice: what is exported.
        out: folder, see `export_folder`.
        overwrite: replace an export.
        progress: called with (samples done, samples).

    Raises:
        StoreError: the dataset is damaged, or `out` cannot be written.
    """
    with collected(out, choice, {"layout": "npz"}, overwrite=overwrite) as folder:
        for done, index in enumerate(choice.indices.tolist(), start=1):
            path = folder / f"{index:08d}.npz"
            if not path.exists():
                arrays = choice.data.read(index, choice.names)
                with publish_file(path) as temporary:
                    np.savez(temporary, **arrays, record=np.array(choice.record_json(index)))  # type: ignore[arg-type]
            if progress is not None:
                progress(done, len(choice))
