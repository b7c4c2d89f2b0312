"""The twin's own way to cut a surface: irregular pieces, and none where no antenna sees anything."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.forward_model import ForwardModel
from waveformer.simulator.mesh import SurfaceMesh
from waveformer.simulator.quadrature import faces_that_can_face, sample_surface
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture
from waveformer.simulator.scene import VISIBLE, SampleTable, sample_states
from waveformer.simulator.target import rotate
from waveformer.simulator.tessellation import tessellate

# Edges are cut off their middle by up to this share of their length.
_SPREAD = 0.15
_MAXIMUM_TESTED_ANTENNAS = 400


def divide_irregularly(mesh: SurfaceMesh, times: int, rng: np.random.Generator) -> SurfaceMesh:
    """Every face into four, each edge cut at a random place around its middle: the same surface in other pieces.

    Cuts at the middle would give the very pieces into which the simulator divides the faces of the file.

    Args:
        mesh: F faces.
        times: how often.
        rng: draws the places.

    Returns:
        Mesh of 4^times F faces; neighbours share the corners of their common edge.
    """
    for _ in range(times):
        edges = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1), axis=-1)
        ends, edge_of_side = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
        share = 0.5 + rng.uniform(-_SPREAD, _SPREAD, size=(len(ends), 1))
        cuts_m = (1.0 - share) * mesh.vertices_m[ends[:, 0]] + share * mesh.vertices_m[ends[:, 1]]
        a, b, c = mesh.faces.T
        ab, bc, ca = (edge_of_side.reshape(-1, 3) + len(mesh.vertices_m)).T
        corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.stack([np.stack(corner, axis=1) for corner in corners], axis=1).reshape(-1, 3)
        mesh = replace(mesh, vertices_m=np.concatenate([mesh.vertices_m, cuts_m]), faces=faces)
    return mesh


def without_hidden_faces(model: ForwardModel) -> ForwardModel:
    """The same model, summing only faces that some antenna sees or that touch such a face; all still cast shadows.

    Every piece is tested from some antennas on a coarse grid over the aperture. What it misses is seen from between
    them only, and lies apart from all that they see. The insides of scans with holes, which reflect on both sides,
    are most of what goes.
    """
    positions = antennas_to_test(model.antennas)
    spacing_m = model.numerics.spacing_wavelengths * SPEED_OF_LIGHT_M_PER_S / model.chirp.center_hz
    placed = []
    for item in model.placed:
        mesh = item.mesh
        normals = rotate(mesh.normals, item.pose)
        facing = faces_that_can_face(
            item.vertices_m[mesh.faces], normals, mesh.two_sided, positions, positions
        )
        samples = sample_surface(mesh, item.pose, spacing_m, facing)
        states = sample_states(
            model.scene, SampleTable(samples.points_m, samples.normals), mesh.two_sided, positions, None
        )
        seen = np.zeros(len(mesh.faces), dtype=bool)
        seen[tessellate(mesh, spacing_m, facing).face[(states == VISIBLE).any(axis=0)]] = True
        near = np.zeros(len(mesh.vertices_m), dtype=bool)
        near[mesh.faces[seen]] = True
        kept = replace(mesh, faces=mesh.faces[near[mesh.faces].any(axis=1)])
        placed.append(replace(item, mesh=kept))
    return replace(model, placed=placed)


def antennas_to_test(aperture: Aperture) -> NDArray[np.float64]:
    """Transmitters spread evenly over a grid of antennas, its edges included, shape (n, 3)."""
    x, y = (np.unique(np.round(aperture.tx_m[:, axis], 9)) for axis in (0, 1))
    step = max(1, int(np.ceil(np.sqrt(len(x) * len(y) / _MAXIMUM_TESTED_ANTENNAS))))
    chosen = [np.unique(np.append(axis[::step], axis[-1])) for axis in (x, y)]
    height_m = float(np.median(aperture.tx_m[:, 2]))
    grid = np.meshgrid(*chosen, indexing="ij")
    return np.stack([*(axis.ravel() for axis in grid), np.full(grid[0].size, height_m)], axis=1)
