"""A 3-D scene as plain layers, so that every renderer draws the same thing."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.image import Image
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.radar import Aperture

ISO_LEVELS_DB = (-6.0, -12.0)
MAX_POINTS = 2000
MAX_FACES = 150_000  # what a browser turns smoothly, and some 5 MB of HTML

# Okabe-Ito colours, distinct for colour-blind readers; the stronger level is the more opaque one.
_ISO_STYLES = (("#d55e00", 1.0), ("#e69f00", 0.35))
_MESH_STYLE = ("#8c8c8c", 0.35)
_APERTURE_COLOR = "#0072b2"
_BOX_COLOR = "#8b5a2b"
_EDGE_POINTS_PITCH_M = 0.002


@dataclass(frozen=True, eq=False)
class Layer:
    """One thing to draw: a surface, or points if it has no faces.

    Attributes:
        name: for the legend.
        vertices_m: (V, 3) metres, radar frame.
        faces: (F, 3) int; F = 0 means that the vertices are drawn as points.
        color: ``#rrggbb``.
        opacity: 0 (invisible) to 1.
    """

    name: str
    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    color: str
    opacity: float


def scene_layers(
    *,
    meshes: Sequence[SurfaceMesh] = (),
    aperture: Aperture | None = None,
    image: Image | None = None,
    box_m: NDArray[np.float64] | None = None,
) -> list[Layer]:
    """What there is to draw.

    Args:
        meshes: drawn as half-transparent grey surfaces.
        aperture: its positions, evenly thinned to at most `MAX_POINTS`.
        image: drawn as surfaces of constant |image|, `ISO_LEVELS_DB` below its peak.
        box_m: opposite corners of a box, shape (2, 3), drawn as its edges.

    Returns:
        Layers, none of them empty; no more than `MAX_FACES` faces each.
    """
    layers = [_surface(f"mesh {mesh.name}", mesh.vertices_m, mesh.faces, *_MESH_STYLE) for mesh in meshes]
    if aperture is not None:
        positions_m = np.concatenate([aperture.tx_m, *([] if aperture.rx_m is None else [aperture.rx_m])])
        thinned_m = positions_m[:: -(-len(positions_m) // MAX_POINTS)]
        layers.append(Layer("antenna positions", thinned_m, np.zeros((0, 3), np.int64), _APERTURE_COLOR, 1.0))
    if box_m is not None:
        layers.append(Layer("box", box_edges(box_m), np.zeros((0, 3), np.int64), _BOX_COLOR, 1.0))
    if image is not None:
        for level_db, style in zip(ISO_LEVELS_DB, _ISO_STYLES, strict=True):
            vertices_m, faces = isosurface(image, level_db)
            if len(faces):
                layers.append(_surface(f"image at {level_db:g} dB of its peak", vertices_m, faces, *style))
    return layers


def box_edges(box_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points 2 mm apart or closer on the twelve edges of a box.

    Args:
        box_m: opposite corners, shape (2, 3).

    Returns:
        Shape (P, 3).
    """
    points = []
    for axis in range(3):
        low, high = box_m[0, axis], box_m[1, axis]
        ticks = np.linspace(low, high, int(np.ceil((high - low) / _EDGE_POINTS_PITCH_M)) + 1)
        others = [other for other in range(3) if other != axis]
        for corner in np.ndindex(2, 2):
            edge = np.empty((len(ticks), 3))
            edge[:, axis] = ticks
            edge[:, others] = box_m[corner, others]
            points.append(edge)
    return np.concatenate(points)


def isosurface(image: Image, level_db: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The surface on which |image| is `level_db` relative to its peak.

    Returns:
        Vertices (V, 3) in metres and faces (F, 3); empty for a flat or an empty image.
    """
    magnitude = np.abs(image.values)
    peak = float(magnitude.max())
    if min(image.grid.shape) < 2 or not peak > 0:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    import pyvista

    volume = pyvista.RectilinearGrid(image.grid.x, image.grid.y, image.grid.z)
    volume["magnitude"] = magnitude.ravel(order="F")  # VTK numbers its points with x fastest
    surface = volume.contour([peak * 10 ** (level_db / 20)], scalars="magnitude")
    return np.asarray(surface.points, np.float64), surface.regular_faces.astype(np.int64)


def save_layers(layers: Iterable[Layer], path: str | os.PathLike[str]) -> None:
    """Write layers as an NPZ file, for a renderer in another process."""
    arrays: dict[str, NDArray[np.generic]] = {}
    for i, layer in enumerate(layers):
        arrays[f"{i}.vertices_m"] = layer.vertices_m
        arrays[f"{i}.faces"] = layer.faces
        arrays[f"{i}.style"] = np.array([layer.name, layer.color, str(layer.opacity)])
    np.savez(Path(path), **arrays)  # type: ignore[arg-type]  # the stub knows allow_pickle only


def load_layers(path: str | os.PathLike[str]) -> list[Layer]:
    """Read what `save_layers` wrote."""
    with np.load(path, allow_pickle=False) as arrays:
        layers = []
        for i in range(len(arrays.files) // 3):
            name, color, opacity = map(str, arrays[f"{i}.style"])
            layers.append(Layer(name, arrays[f"{i}.vertices_m"], arrays[f"{i}.faces"], color, float(opacity)))
    return layers


def _surface(
    name: str, vertices_m: NDArray[np.float64], faces: NDArray[np.int64], color: str, opacity: float
) -> Layer:
    if len(faces) > MAX_FACES:
        import pyvista

        surface = pyvista.PolyData.from_regular_faces(vertices_m, faces).decimate(1 - MAX_FACES / len(faces))
        vertices_m, faces = np.asarray(surface.points, np.float64), surface.regular_faces.astype(np.int64)
    return Layer(name, vertices_m, faces, color, opacity)
