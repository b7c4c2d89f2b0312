"""Child process of `waveformer.eval.viewer`: layers.npz in, picture.png out, drawn with VTK."""

from __future__ import annotations

import sys

import pyvista

from waveformer.eval.scene import load_layers

_CM_PER_M = 100.0
_WINDOW_PIXELS = (1200, 1000)
_VIEW_DIRECTION = (1.5, -1.9, 0.9)  # from the front right and above, as the HTML view starts


def render(scene_path: str, picture_path: str) -> None:
    """Draw the layers of an NPZ file as PNG."""
    plotter = pyvista.Plotter(off_screen=True, window_size=_WINDOW_PIXELS)
    plotter.set_background("white")
    for layer in load_layers(scene_path):
        style = {"color": layer.color, "opacity": layer.opacity, "label": layer.name, "ambient": 0.35}
        if len(layer.faces):
            surface = pyvista.PolyData.from_regular_faces(layer.vertices_m * _CM_PER_M, layer.faces)
            plotter.add_mesh(surface, smooth_shading=True, split_sharp_edges=True, **style)
        else:
            points = pyvista.PolyData(layer.vertices_m * _CM_PER_M)
            plotter.add_mesh(points, style="points", point_size=3, **style)
    plotter.show_grid(xtitle="x [cm]", ytitle="y [cm]", ztitle="z [cm]", color="#555555", font_size=12)
    plotter.add_legend(bcolor=None, face="circle", size=(0.24, 0.10), loc="upper left")
    plotter.view_vector(_VIEW_DIRECTION, viewup=(0, 0, 1))
    plotter.camera.zoom(0.9)
    plotter.screenshot(picture_path)


if __name__ == "__main__":
    render(*sys.argv[1:])
