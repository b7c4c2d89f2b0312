"""Many samples of a dataset in one picture: the complete surface, and what the radar sees of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.datagen.dataset_reader import Dataset

_TRUTH_POINTS = 1500  # the first ones cover the surface
_COLUMNS = 6
_PANEL_INCHES = 1.7


def contact_sheet(data: Dataset, indices: Sequence[int], path: Path) -> None:
    """Draw samples, each from the front (x, z) and from above (x, y).

    Grey is the truth, red the first partial; a sample with candidates shows the chosen one in blue.

    Args:
        data: with the array truth_m.
        indices: of committed samples.
        path: PNG.

    Raises:
        StoreError: a sample is not committed or damaged.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(_COLUMNS, max(1, len(indices)))
    rows = -(-len(indices) // columns)
    figure = Figure(figsize=(_PANEL_INCHES * columns, 2 * _PANEL_INCHES * rows + 0.4), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2 * rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for place, index in enumerate(indices):
        row, column = divmod(place, columns)
        clouds = _clouds(data, int(index))
        for view, (first, second) in enumerate(((0, 2), (0, 1))):
            axis = axes[2 * row + view, column]
            for points, colour, size in clouds:
                axis.scatter(points[:, first], points[:, second], s=size, c=colour, linewidths=0)
            axis.set_aspect("equal", "datalim")
        axes[2 * row, column].set_title(f"{index} {_name(data.record(int(index)))}", fontsize=6)
    figure.savefig(path, dpi=150)


def _clouds(data: Dataset, index: int) -> list[tuple[NDArray[Any], str, float]]:
    """Points, colour and size of what is shown of a sample."""
    names = [name for name in ("truth_m", "partial_m", "candidate_m", "chosen") if name in data.arrays]
    sample = data.read(index, names)
    found = []
    if "truth_m" in sample:
        found.append((sample["truth_m"][:_TRUTH_POINTS], "0.75", 1.0))
    if "partial_m" in sample:
        found.append((_finite(sample["partial_m"][0]), "tab:red", 1.5))
    if "candidate_m" in sample and int(sample["chosen"]) >= 0:
        found.append((_finite(sample["candidate_m"][int(sample["chosen"])]), "tab:blue", 1.5))
    return found


def _finite(points: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(points[np.isfinite(points).all(axis=1)])


def _name(record: dict[str, Any]) -> str:
    return str(record.get("object_id", "")).rsplit("/", 1)[-1][:18]
