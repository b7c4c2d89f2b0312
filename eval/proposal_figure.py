"""One proposal as a picture: image, normals, candidate levels with their loss, and the chosen surface on the truth."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from waveformer.model.proposal import Proposal
from waveformer.simulator.mesh import SurfaceMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DYNAMIC_RANGE_DB = 30.0
_ARROWS = 900
_DOTS = 6000
_TRUTH, _FOUND = "#9aa5b1", "#c0392b"


def proposal_figure(
    proposal: Proposal, mesh: SurfaceMesh | None, path: str | os.PathLike[str], *, title: str = ""
) -> None:
    """Draw a proposal, seen from the front (x to the right, z up) and from above.

    Args:
        proposal: with or without a surface.
        mesh: the truth in the radar frame, if it is known.
        path: picture to write.
        title: above all panels.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 3)
    figure.suptitle(title + (f" - {proposal.reason}" if proposal.reason else ""))
    corners = None if mesh is None else 100.0 * mesh.vertices_m
    _image(figure, panels[0, 0], proposal, 1, ("x (cm)", "z (cm)"), "image |S| from the front, dB")
    _image(figure, panels[1, 0], proposal, 2, ("x (cm)", "y (cm)"), "image |S| from above, dB")
    for panel, axes in ((panels[0, 0], (0, 2)), (panels[1, 0], (0, 1))):
        _outline(panel, corners, axes)
    _normals(panels[0, 1], proposal)
    _losses(panels[1, 1], proposal)
    _levels(figure, panels[0, 2], proposal, corners)
    _chosen(panels[1, 2], proposal, corners)
    figure.savefig(path, dpi=90, format="png")


def _image(
    figure: Any, panel: Axes, proposal: Proposal, axis: int, labels: tuple[str, str], title: str
) -> None:
    panel.set(title=title, xlabel=labels[0], ylabel=labels[1])
    if proposal.focus is None:
        return
    grid = proposal.focus.grid
    along = [grid.x, grid.y, grid.z]
    across = [100.0 * along[place] for place in range(3) if place != axis]
    magnitude = np.abs(proposal.focus.image).max(axis=axis)
    level_db = 20.0 * np.log10(np.maximum(magnitude, 1e-30) / max(float(magnitude.max()), 1e-30))
    extent = (across[0][0], across[0][-1], across[1][0], across[1][-1])
    drawn = panel.imshow(
        level_db.T, origin="lower", extent=extent, vmin=-_DYNAMIC_RANGE_DB, vmax=0.0, cmap="inferno", aspect="equal"
    )  # fmt: skip
    figure.colorbar(drawn, ax=panel, shrink=0.8)


def _outline(panel: Axes, corners_cm: NDArray[np.float64] | None, axes: tuple[int, int]) -> None:
    if corners_cm is None:
        return
    from scipy.spatial import ConvexHull

    flat = corners_cm[:, axes]
    hull = flat[ConvexHull(flat).vertices]
    hull = np.concatenate([hull, hull[:1]])
    panel.plot(hull[:, 0], hull[:, 1], color="#7fd4ff", linewidth=0.9, label="outline (hull) of the truth")


def _normals(panel: Axes, proposal: Proposal) -> None:
    panel.set(title="normals, from the front", xlabel="x (cm)", ylabel="z (cm)")
    if proposal.focus is None or proposal.focus.normals is None or proposal.mask is None:
        return
    index = np.argwhere(proposal.mask.mask)
    index = index[:: max(1, len(index) // _ARROWS)]
    grid = proposal.focus.grid
    normals = proposal.focus.normals[tuple(index.T)]
    panel.quiver(
        100.0 * grid.x[index[:, 0]], 100.0 * grid.z[index[:, 2]], normals[:, 0], normals[:, 2], grid.y[index[:, 1]],
        cmap="viridis", angles="xy", scale=25.0, width=0.003,
    )  # fmt: skip
    panel.set_aspect("equal")


def _losses(panel: Axes, proposal: Proposal) -> None:
    panel.set(
        title="loss of every level of f, per antenna", xlabel="level, mm above the chosen one", ylabel="loss"
    )
    if proposal.selection is None:
        return
    losses = zip(proposal.selection.losses, proposal.levels_m, proposal.chosen_m, strict=True)
    for place, (loss, at, chosen) in enumerate(losses):
        if chosen is not None:
            per_antenna = loss / len(proposal.selection.rows)
            panel.plot(1e3 * (at - chosen), per_antenna, marker=".", label=f"component {place + 1}")
    panel.axvline(0.0, color=_FOUND, linewidth=0.8)
    panel.legend(frameon=False)


def _levels(figure: Any, panel: Axes, proposal: Proposal, corners_cm: NDArray[np.float64] | None) -> None:
    panel.set(title="surfaces of all levels, from the front", xlabel="x (cm)", ylabel="z (cm)")
    _truth_dots(panel, corners_cm, (0, 2))
    for stack, at, chosen in zip(proposal.stacks, proposal.levels_m, proposal.chosen_m, strict=True):
        rows = slice(None, None, max(1, len(stack.points_m) // _DOTS))
        level_mm = 1e3 * (at[stack.level[rows]] - (chosen if chosen is not None else at.mean()))
        points = 100.0 * stack.points_m[rows]
        drawn = panel.scatter(points[:, 0], points[:, 2], c=level_mm, s=1.0, cmap="coolwarm")
        if stack is proposal.stacks[0]:
            figure.colorbar(drawn, ax=panel, shrink=0.8, label="mm above the chosen one")
    panel.set_aspect("equal")


def _chosen(panel: Axes, proposal: Proposal, corners_cm: NDArray[np.float64] | None) -> None:
    panel.set(title="chosen surface (red), from the front", xlabel="x (cm)", ylabel="z (cm)")
    _truth_dots(panel, corners_cm, (0, 2))
    points = 100.0 * proposal.surface_m()
    points = points[:: max(1, len(points) // _DOTS)]
    panel.scatter(points[:, 0], points[:, 2], s=1.5, color=_FOUND)
    panel.set_aspect("equal")


def _truth_dots(panel: Axes, corners_cm: NDArray[np.float64] | None, axes: tuple[int, int]) -> None:
    if corners_cm is not None:
        rows = slice(None, None, max(1, len(corners_cm) // _DOTS))
        panel.scatter(corners_cm[rows, axes[0]], corners_cm[rows, axes[1]], s=0.5, color=_TRUTH)
