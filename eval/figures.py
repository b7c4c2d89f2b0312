"""Pictures of scans and images as PNG files (or any suffix matplotlib knows)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from waveformer.simulator.image import Image
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.radar import Aperture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DYNAMIC_RANGE_DB = 30.0
_STRONG_DB = -20.0
_COLORS = "inferno"  # perceptually uniform, and its brightness alone carries the value
_OUTLINE = "#7fd4ff"
_BOX_COLOR = "#d9a066"
_BOX_AIR_CM = 1.0
_NOT_IMAGED = "#555555"
_CM_PER_M = 100.0
_MAX_WATERFALL_ROWS = 1024
_SILHOUETTE_PIXELS = 320


def image_figure(
    image: Image,
    path: str | os.PathLike[str],
    *,
    meshes: Sequence[SurfaceMesh] = (),
    aperture: Aperture | None = None,
    box_m: NDArray[np.float64] | None = None,
) -> None:
    """Draw the maximum projections of |image| from above, from the front and from the side.

    Args:
        image: voxel image; colours are dB relative to its own peak.
        path: picture to write, replaced if it exists.
        meshes: each drawn as the outline of its shadow in each view.
        aperture: its extent is drawn in the view from above.
        box_m: opposite corners of a box, shape (2, 3); the views reach as far, and grey is what is not imaged.
    """
    magnitude = np.abs(image.values)
    peak = float(magnitude.max())
    level_db = _decibel(magnitude, peak)
    axes_cm = [axis * _CM_PER_M for axis in (image.grid.x, image.grid.y, image.grid.z)]
    limits_cm = np.array([_edges(axis)[[0, -1]] for axis in axes_cm])
    if box_m is not None:
        low_cm, high_cm = box_m * _CM_PER_M + np.array([[-_BOX_AIR_CM], [_BOX_AIR_CM]])
        limits_cm = np.stack(
            [np.minimum(limits_cm[:, 0], low_cm), np.maximum(limits_cm[:, 1], high_cm)], axis=1
        )
    # The drawn width of a panel follows its extent, so that a centimetre is as long in all three.
    extents_cm = [float(np.ptp(limits)) for limits in limits_cm]
    figure = _new_figure(
        width_in=10.5,
        height_in=1.5 + 7.2 * max(extents_cm[1:]) / (2 * extents_cm[0] + extents_cm[1]),
    )
    panels = figure.subplots(1, 3, width_ratios=[extents_cm[0], extents_cm[0], extents_cm[1]])
    views = (("from above", 0, 1, 2), ("from the front", 0, 2, 1), ("from the side", 1, 2, 0))
    for panel, (name, across, up, along) in zip(panels, views, strict=True):
        drawn = panel.pcolormesh(
            _edges(axes_cm[across]),
            _edges(axes_cm[up]),
            level_db.max(axis=along).T,
            cmap=_COLORS,
            vmin=-DYNAMIC_RANGE_DB,
            vmax=0.0,
            rasterized=True,
        )
        for mesh in meshes:
            _draw_silhouette(panel, mesh.triangles_m[:, :, [across, up]] * _CM_PER_M)
        if aperture is not None and along == 2:
            _draw_rectangle(panel, _extent_cm(aperture), "white", "--", "aperture")
        if box_m is not None:
            _draw_rectangle(panel, box_m[:, [across, up]] * _CM_PER_M, _BOX_COLOR, "-", "box")
        if along == 2 and panel.patches:
            panel.legend(loc="upper right", frameon=False, labelcolor="white", fontsize="small")
        panel.set(
            title=name,
            xlabel=f"{'xyz'[across]} [cm]",
            ylabel=f"{'xyz'[up]} [cm]",
            xlim=limits_cm[across],
            ylim=limits_cm[up],
            aspect="equal",
            facecolor=_NOT_IMAGED,
        )
    figure.colorbar(drawn, ax=panels, label="|image| [dB re its peak]", shrink=0.8, pad=0.01)
    place = ", ".join(f"{value:.1f}" for value in image.peak_position_m * _CM_PER_M)
    title = f"Maximum projections; peak at ({place}) cm" if peak > 0 else "Empty image"
    title += ", blue: outline of the mesh" if meshes else ""
    figure.suptitle(title + (", grey: not imaged" if box_m is not None else ""))
    figure.savefig(path)


def range_profile_figure(measurement: Measurement, path: str | os.PathLike[str]) -> None:
    """Draw the range profile of every antenna position and their median.

    Args:
        measurement: scan; levels are dB relative to the transmitted power, |h|^2 = 1.
        path: picture to write, replaced if it exists.
    """
    range_m, magnitude = measurement.range_profile()
    peak = float(magnitude.max())
    strong = np.flatnonzero(magnitude.max(axis=0) >= peak * 10 ** (_STRONG_DB / 20))
    near = range_m <= 1.5 * range_m[strong[-1]]  # beyond it is nothing but sidelobes
    near[:16] = True
    range_cm, magnitude = range_m[near] * _CM_PER_M, magnitude[:, near]
    level_db = 20 * np.log10(np.maximum(magnitude, max(peak, 1e-30) * 1e-5))
    top_db = float(level_db.max())

    figure = _new_figure(width_in=8.0, height_in=6.5)
    waterfall, profile = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    step = -(-len(level_db) // _MAX_WATERFALL_ROWS)
    rows = np.arange(0, len(level_db), step)
    drawn = waterfall.pcolormesh(
        _edges(range_cm),
        np.append(rows, len(level_db)),
        level_db[rows],
        cmap=_COLORS,
        vmin=top_db - 2 * DYNAMIC_RANGE_DB,
        vmax=top_db,
        rasterized=True,
    )
    waterfall.set(
        ylabel="antenna position", title=f"Range profiles of {len(level_db)} antenna positions, no window"
    )
    figure.colorbar(drawn, ax=waterfall, label="received / transmitted power [dB]", pad=0.01)
    profile.fill_between(
        range_cm,
        *np.percentile(level_db, [10, 90], axis=0),
        color="#0072b2",
        alpha=0.25,
        lw=0,
        label="10 to 90 %",
    )
    profile.plot(range_cm, np.median(level_db, axis=0), color="#0072b2", lw=1.3, label="median")
    profile.set(
        xlabel="range [cm]",
        ylabel="[dB]",
        xlim=(range_cm[0], range_cm[-1]),
        ylim=(top_db - 2 * DYNAMIC_RANGE_DB, top_db + 3),
    )
    profile.grid(alpha=0.3)
    profile.legend(loc="upper left", frameon=False)
    figure.savefig(path)


def _new_figure(width_in: float, height_in: float) -> Figure:
    # The Agg canvas without pyplot: no display, no global state, safe in any thread.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, float(np.clip(height_in, 3.0, 14.0))), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _decibel(magnitude: NDArray[Any], reference: float) -> NDArray[np.float64]:
    """20 log10(magnitude / reference), not below twice the dynamic range; all there if the reference is 0."""
    floor = 10.0 ** (-2 * DYNAMIC_RANGE_DB / 20)
    if reference == 0.0:
        return np.full(magnitude.shape, 20 * np.log10(floor))
    return np.asarray(20 * np.log10(np.maximum(magnitude / reference, floor)))


def _edges(centers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cell borders (n + 1,) around increasing cell centres (n,)."""
    if len(centers) == 1:
        return np.array([centers[0] - 0.05, centers[0] + 0.05])
    middle = (centers[1:] + centers[:-1]) / 2
    return np.asarray(np.concatenate([2 * centers[:1] - middle[:1], middle, 2 * centers[-1:] - middle[-1:]]))


def _draw_silhouette(panel: Axes, triangles: NDArray[np.float64]) -> None:
    """Outline the union of projected triangles, shape (F, 3, 2)."""
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    pixel = float((high - low).max()) / _SILHOUETTE_PIXELS
    if pixel == 0.0:
        return
    # Three pixels of margin: the outline must close inside the raster.
    shape = np.ceil((high - low) / pixel).astype(int) + 7
    points = _spread_points(triangles, pixel)
    filled = np.zeros(shape, bool)
    filled[tuple(((points - low) / pixel + 3).astype(int).T)] = True
    filled = ndimage.binary_closing(filled, iterations=2)
    centers = [low[i] + (np.arange(shape[i]) - 2.5) * pixel for i in range(2)]
    smooth = ndimage.gaussian_filter(filled.astype(float), 1.0)
    panel.contour(*centers, smooth.T, levels=[0.5], colors=_OUTLINE, linewidths=0.9)


def _spread_points(triangles: NDArray[np.float64], pixel: float) -> NDArray[np.float64]:
    """About four points per pixel on projected triangles, besides their corners."""
    (ax, ay), (bx, by) = (triangles[:, 1] - triangles[:, 0]).T, (triangles[:, 2] - triangles[:, 0]).T
    expected = 2.0 * np.abs(ax * by - ay * bx) / pixel**2  # 4 * area / pixel area
    # A mesh has many layers behind each other; a million points fill the raster anyway.
    expected *= min(1.0, 1e6 / max(expected.sum(), 1.0))
    rng = np.random.default_rng(0)
    counts = rng.poisson(expected)
    chosen = np.repeat(triangles, counts, axis=0)
    u, v = rng.random((2, len(chosen), 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    inside = chosen[:, 0] + u * (chosen[:, 1] - chosen[:, 0]) + v * (chosen[:, 2] - chosen[:, 0])
    return np.concatenate([triangles.reshape(-1, 2), inside])


def _extent_cm(aperture: Aperture) -> NDArray[np.float64]:
    """Lowest and highest x and y of an aperture, shape (2, 2)."""
    positions_cm = np.concatenate([aperture.tx_m, aperture.receivers_m])[:, :2] * _CM_PER_M
    return np.array([positions_cm.min(axis=0), positions_cm.max(axis=0)])


def _draw_rectangle(panel: Axes, corners: NDArray[np.float64], color: str, line: str, label: str) -> None:
    from matplotlib.patches import Rectangle

    low, high = corners
    panel.add_patch(
        Rectangle(tuple(low), *(high - low), fill=False, color=color, lw=0.9, ls=line, label=label)
    )
