"""A picture of a pose recovery: outlines, errors stage by stage, power over the aperture."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage

from waveformer.simulator.forward import simulate
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.pose_recovery import PoseFit
from waveformer.simulator.quadrature import sample_surface
from waveformer.simulator.rigid_pose import RigidPose
from waveformer.simulator.target import Target

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_START, _FOUND, _TRUE = "#d55e00", "#0072b2", "#b0b0b0"
_PIXELS = 160
_DYNAMIC_RANGE_DB = 30.0
_LEAST_MM, _LEAST_DEG = 1e-3, 1e-3


def pose_figure(
    fit: PoseFit,
    mesh: SurfaceMesh,
    measurement: Measurement,
    start_pose: NDArray[np.float64],
    true_pose: NDArray[np.float64],
    path: str | os.PathLike[str],
) -> None:
    """Draw where an object was thought to be, was found, and is.

    Args:
        fit: from `recover_pose`.
        mesh: the object.
        measurement: a scan over a grid of positions.
        start_pose, true_pose: poses (4, 4).
        path: picture to write, replaced if it exists.
    """
    # The Agg canvas without pyplot: no display, no global state, safe in any thread.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, 3)
    poses = {"true": true_pose, "start": start_pose, "found": fit.pose}
    styles = {"true": (_TRUE, "-", 4.0), "start": (_START, "-", 1.0), "found": (_FOUND, "--", 1.3)}
    for panel, (across, up, name) in zip(
        panels[0], ((0, 1, "from above"), (0, 2, "from the front")), strict=False
    ):
        for label, pose in poses.items():
            color, line, width = styles[label]
            _draw_outline(panel, mesh, pose, (across, up), color, line, width)
            panel.plot([], [], color=color, ls=line, lw=width, label=label)
        panel.set(title=name, xlabel=f"{'xyz'[across]} [cm]", ylabel=f"{'xyz'[up]} [cm]", aspect="equal")
    # outside of all panels: how high the outlines are depends on the object
    figure.legend(*panels[0, 1].get_legend_handles_labels(), frameon=False, ncols=3, loc="outside upper left")
    _draw_errors(panels[0, 2], fit, mesh, start_pose, true_pose)

    powers = {"measured": _power(measurement)}
    for label in ("start", "found"):
        source = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
        target = Target(source, pose=poses[label])
        powers[f"simulated, {label}"] = _power(simulate(target, measurement.chirp, measurement.aperture))
    top_db = 10.0 * np.log10(powers["measured"].max())
    x_cm, y_cm = 100.0 * measurement.aperture.tx_m[:, :2].T
    for panel, (label, power) in zip(panels[1], powers.items(), strict=True):
        level_db = 10.0 * np.log10(power) - top_db
        drawn = panel.tripcolor(
            x_cm, y_cm, level_db, vmin=-_DYNAMIC_RANGE_DB, vmax=0.0, cmap="inferno", shading="gouraud"
        )
        panel.set(title=f"power, {label}", xlabel="x [cm]", ylabel="y [cm]", aspect="equal")
    figure.colorbar(drawn, ax=panels[1], label="[dB re measured peak]", pad=0.01)
    figure.savefig(path)


def _power(measurement: Measurement) -> NDArray[np.float64]:
    """Mean over the band of every position, (N,)."""
    return np.asarray((np.abs(measurement.h.astype(np.complex128)) ** 2).mean(axis=1))


def _draw_errors(
    panel: Axes,
    fit: PoseFit,
    mesh: SurfaceMesh,
    start_pose: NDArray[np.float64],
    true_pose: NDArray[np.float64],
) -> None:
    """Errors of the pose after every stage."""
    middle_m = 0.5 * (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0))
    truth = RigidPose.of(true_pose, middle_m)
    stages = ["start", *(step.stage for step in fit.history)]
    apart = [
        RigidPose.of(pose, middle_m).apart(truth)
        for pose in (start_pose, *(step.pose for step in fit.history))
    ]
    shift_mm = [max(1e3 * shift_m, _LEAST_MM) for shift_m, _ in apart]
    turn_deg = [max(degrees, _LEAST_DEG) for _, degrees in apart]
    panel.semilogy(range(len(stages)), shift_mm, "o-", color=_FOUND, label="position [mm]")
    panel.semilogy(range(len(stages)), turn_deg, "s--", color=_START, label="turn [degrees]")
    panel.set_xticks(range(len(stages)), stages, rotation=30, ha="right", fontsize="small")
    panel.set(title="error after every stage")
    panel.grid(alpha=0.3)
    panel.legend(frameon=False, fontsize="small")


def _draw_outline(
    panel: Axes,
    mesh: SurfaceMesh,
    pose: NDArray[np.float64],
    axes: tuple[int, int],
    color: str,
    line: str,
    width: float,
) -> None:
    """Outline the shadow of the mesh along the third axis."""
    pixel_m = float(mesh.extent_m.max()) / _PIXELS
    points_m = sample_surface(mesh, pose, pixel_m).points_m[:, list(axes)]
    low = points_m.min(axis=0) - 4 * pixel_m  # the outline must close inside the raster
    cells = ((points_m - low) / pixel_m).astype(int)
    filled = np.zeros(cells.max(axis=0) + 5, dtype=bool)
    filled[tuple(cells.T)] = True
    smooth = ndimage.gaussian_filter(ndimage.binary_closing(filled, iterations=2).astype(float), 1.0)
    centers_cm = [100.0 * (low[i] + (np.arange(filled.shape[i]) + 0.5) * pixel_m) for i in range(2)]
    panel.contour(*centers_cm, smooth.T, levels=[0.5], colors=color, linestyles=line, linewidths=width)
