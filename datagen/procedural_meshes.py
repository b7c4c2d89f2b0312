"""Objects made in code, so that a dataset can be tried without any mesh files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from waveformer.simulator.front_end_streams import generator

if TYPE_CHECKING:
    import trimesh

KINDS = ("ball", "box", "can", "mug", "hammer", "bowl")
_EDGE_M = 0.004


def write_procedural_meshes(folder: Path, count: int, seed: int = 0) -> None:
    """Write closed meshes of several kinds and proportions as PLY, in metres, one folder a kind.

    Those that are there are left alone.

    Args:
        folder: to write to, `<kind>/<kind>_<number>.ply`.
        count: of meshes.
        seed: of their proportions.

    Raises:
        StoreError: the folder cannot be written.
    """
    from waveformer.simulator.storage import publish_file

    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        path = folder / kind / f"{kind}_{number:03d}.ply"
        if not path.exists():
            mesh = procedural_mesh(kind, generator(seed, f"procedural {kind} {number}"))
            with publish_file(path) as temporary:
                mesh.export(temporary)


def procedural_mesh(kind: str, rng: np.random.Generator) -> trimesh.Trimesh:
    """One object of a kind of `KINDS`, 5 to 30 cm long, its proportions drawn."""
    from waveformer.simulator import primitives
    from waveformer.simulator.lofting import lathe

    wide, high, deep = rng.uniform(0.05, 0.12, 3)
    if kind == "ball":
        ball = primitives.sphere(0.5 * wide, _EDGE_M)
        ball.apply_scale([1.0, float(rng.uniform(0.7, 1.0)), float(rng.uniform(0.7, 1.0))])
        return ball
    if kind == "box":
        return primitives.box(wide, high, deep, _EDGE_M)
    if kind == "can":
        return primitives.cylinder(0.5 * wide, high, _EDGE_M)
    if kind == "mug":
        return primitives.mug(_EDGE_M, height_m=high, diameter_m=wide)
    if kind == "hammer":
        hammer = primitives.hammer(_EDGE_M)
        hammer.apply_scale(rng.uniform(0.5, 1.0, 3))
        return hammer
    radius, wall = 0.6 * wide, 0.004
    turn = np.linspace(0.0, 0.5 * np.pi, 40)
    outer = [(radius * np.sin(t), radius * (1.0 - np.cos(t))) for t in turn]
    inner = [((radius - wall) * np.sin(t), radius - (radius - wall) * np.cos(t)) for t in turn[::-1]]
    return lathe([*outer, *inner], _EDGE_M)
