"""3-D pictures of a scene: a PNG, or one HTML file to turn with the mouse."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from waveformer.eval.scene import Layer, save_layers

_CM_PER_M = 100.0
_CHILD_MODULE = "waveformer.eval.offscreen"
_CHILD_TIMEOUT_S = 120
_FALLBACK_MAX_FACES = 20_000  # matplotlib sorts every face in Python

# No browser may load anything from elsewhere on behalf of the file, whatever the plotting library does.
_CONTENT_POLICY = (
    '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
    "script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:; "
    'worker-src blob:">'
)


def render_png(layers: Sequence[Layer], path: str | os.PathLike[str]) -> str | None:
    """Draw the scene with VTK, or with matplotlib where VTK does not work.

    VTK without a working OpenGL ends the process by a segmentation fault, which cannot be caught; so it
    runs in a child process.

    Args:
        layers: from `waveformer.eval.scene.scene_layers`.
        path: PNG file to write, replaced if it exists.

    Returns:
        None, or why matplotlib was used instead.
    """
    with tempfile.TemporaryDirectory() as folder:
        scene, picture = Path(folder) / "scene.npz", Path(folder) / "scene.png"
        save_layers(layers, scene)
        reason = _render_in_child(scene, picture)
        if reason is None:
            Path(path).write_bytes(picture.read_bytes())
        else:
            _render_with_matplotlib(layers, path)
    return reason


def export_html(layers: Sequence[Layer], path: str | os.PathLike[str]) -> None:
    """Write the scene as one self-contained HTML file, without a need for OpenGL here or a network there.

    Args:
        layers: from `waveformer.eval.scene.scene_layers`.
        path: HTML file to write, replaced if it exists; 5 MB of it are the drawing library.
    """
    import plotly.graph_objects as go

    figure = go.Figure()
    for layer in layers:
        x, y, z = (layer.vertices_m.T * _CM_PER_M).astype(np.float32)
        shared = {"x": x, "y": y, "z": z, "name": layer.name, "showlegend": True, "opacity": layer.opacity}
        if len(layer.faces):
            i, j, k = layer.faces.T.astype(np.int32)
            figure.add_trace(
                go.Mesh3d(
                    **shared,
                    i=i,
                    j=j,
                    k=k,
                    color=layer.color,
                    lighting={"ambient": 0.6, "diffuse": 0.6, "specular": 0.1},
                    hovertemplate="x %{x:.1f} y %{y:.1f} z %{z:.1f} cm",
                )
            )
        else:
            figure.add_trace(go.Scatter3d(**shared, mode="markers", marker={"size": 2, "color": layer.color}))
    figure.update_layout(
        title="Turn: drag. Zoom: wheel. Hide a layer: click its name.",
        scene={
            "aspectmode": "data",
            "camera": {"eye": {"x": 1.7, "y": -2.2, "z": 0.7}},
            **{f"{axis}axis": {"title": {"text": f"{axis} [cm]"}} for axis in "xyz"},
        },
        legend={"x": 0, "y": 1, "itemsizing": "constant"},
        margin={"l": 0, "r": 0, "t": 40, "b": 0},
    )
    page = figure.to_html(include_plotlyjs=True, default_height="95vh", config={"displaylogo": False})
    Path(path).write_text(page.replace("<head>", f"<head>{_CONTENT_POLICY}", 1), encoding="utf-8")


def _render_in_child(scene: Path, picture: Path) -> str | None:
    """Run the VTK renderer; None, or why it failed."""
    # -P: a file of the working directory must not shadow a module of the child.
    command = [sys.executable, "-P", "-m", _CHILD_MODULE, str(scene), str(picture)]
    try:
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=_CHILD_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return f"VTK did not finish within {_CHILD_TIMEOUT_S} s"
    if done.returncode == 0 and picture.exists():
        return None
    if done.returncode < 0:
        return f"VTK was ended by signal {-done.returncode} (no working OpenGL? install libgl1 and libegl1)"
    lines = done.stderr.strip().splitlines()
    return f"VTK failed: {lines[-1] if lines else f'exit code {done.returncode}'}"


def _render_with_matplotlib(layers: Sequence[Layer], path: str | os.PathLike[str]) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure(figsize=(10, 8), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    panel = figure.add_subplot(projection="3d")
    for layer in layers:
        x, y, z = layer.vertices_m.T * _CM_PER_M
        if len(layer.faces):
            faces = layer.faces[:: -(-len(layer.faces) // _FALLBACK_MAX_FACES)]
            panel.plot_trisurf(x, y, z, triangles=faces, color=layer.color, alpha=layer.opacity, lw=0)
        else:
            panel.scatter(x, y, z, s=2, color=layer.color)
    panel.set(xlabel="x [cm]", ylabel="y [cm]", zlabel="z [cm]", aspect="equal")
    panel.legend(handles=[Patch(color=layer.color, label=layer.name) for layer in layers], loc="upper left")
    figure.savefig(path, format="png")
