"""Mesh -> scene -> visibility -> raw FMCW signal H, and its imaging adjoint.

Public names are loaded on first use, so that importing the package loads neither mitsuba nor torch.
"""

from __future__ import annotations

import importlib
from typing import Any

_PUBLIC = {
    "Antenna": "antenna",
    "Aperture": "radar",
    "Chirp": "radar",
    "FrontEnd": "front_end",
    "Grid": "grid",
    "Image": "image",
    "Box": "occluders",
    "Material": "materials",
    "Measurement": "measurement",
    "MeshError": "errors",
    "RadarError": "errors",
    "Sheet": "occluders",
    "StoreError": "errors",
    "Target": "target",
    "WaveformerError": "errors",
    "backproject": "imaging",
    "Focus": "focusing",
    "focus": "focusing",
    "load_mesh": "mesh",
    "load_scene": "scene_file",
    "simulate": "forward",
    "simulate_points": "points",
    "simulate_to_store": "forward_stream",
    "with_receivers": "arrays",
}

__all__ = [
    "Antenna",
    "Aperture",
    "Box",
    "Chirp",
    "Focus",
    "FrontEnd",
    "Grid",
    "Image",
    "Material",
    "Measurement",
    "MeshError",
    "RadarError",
    "Sheet",
    "StoreError",
    "Target",
    "WaveformerError",
    "backproject",
    "focus",
    "load_mesh",
    "load_scene",
    "simulate",
    "simulate_points",
    "simulate_to_store",
    "with_receivers",
]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
