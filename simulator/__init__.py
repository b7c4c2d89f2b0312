"""Mesh -> scene -> visibility -> raw FMCW signal H, and its imaging adjoint.

Public names are loaded on first use, so that importing the package loads neither mitsuba nor torch.
"""

from __future__ import annotations

import importlib
from typing import Any

_PUBLIC = {
    "Aperture": "radar",
    "Chirp": "radar",
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
    "load_mesh": "mesh",
    "simulate": "forward",
    "simulate_points": "points",
}

__all__ = [
    "Aperture",
    "Box",
    "Chirp",
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
    "load_mesh",
    "simulate",
    "simulate_points",
]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
