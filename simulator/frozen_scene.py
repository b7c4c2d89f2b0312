"""The discrete part of a differentiable scene: which pieces a surface is cut into, which antenna sees which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.arguments import coordinates, instance, shown, triangles
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.matter_parameters import Matter, as_sheets
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.mesh_repair import merge_vertices, unique_faces
from waveformer.simulator.numerics import DIFFERENTIABLE, DIFFERENTIABLE_THROUGH_WALLS, Numerics
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.runtime import activate
from waveformer.simulator.surroundings import Surroundings


@dataclass(frozen=True, eq=False)
class FrozenScene:
    """The discrete part of a scene, from `freeze`: valid while surfaces and antennas stay near where they were.

    Attributes:
        faces: of the mesh, without those of zero area, shape (F, 3).
        targets: pieces of its faces, and what sees them.
        walls: faces of the box.
        chirp: the radar's.
        numerics: kernel settings.
        belongs_to: what it is valid for, by name.
    """

    faces: NDArray[np.int64]
    targets: list[Any]
    walls: list[Any]
    chirp: Chirp
    numerics: Numerics
    belongs_to: dict[str, Any]

    @property
    def num_samples(self) -> int:
        """Surface samples that some antenna sees."""
        return sum(len(target.pieces) for target in self.targets)


def freeze(
    vertices: torch.Tensor | ArrayLike,
    faces: torch.Tensor | ArrayLike,
    chirp: Chirp,
    tx_m: torch.Tensor | ArrayLike,
    rx_m: torch.Tensor | ArrayLike | None = None,
    *,
    sheets: Sequence[Any] = (),
    box: Any = None,
    antenna: Antenna | None = None,
    mode: str | Numerics = "fast",
) -> FrozenScene:
    """Find what is discrete in a scene: pieces of the surface, and which antenna sees which.

    Args:
        vertices, faces, chirp, tx_m, rx_m, sheets, box, antenna, mode: as in `simulate`.

    Returns:
        What `simulate(..., frozen=...)` takes: an optimisation freezes anew when things have moved by more than
        about a wavelength, not at every step.

    Raises:
        MeshError, RadarError: as `simulate`.
    """
    activate()
    from waveformer.simulator.frozen import freeze_target
    from waveformer.simulator.frozen_surroundings import freeze_walls
    from waveformer.simulator.scene import build_scene

    instance("chirp", chirp, Chirp)
    mesh = _mesh(*triangles(vertices, faces))
    aperture = Aperture(coordinates("tx_m", tx_m), None if rx_m is None else coordinates("rx_m", rx_m))
    surroundings = Matter(None, None, 0.0, as_sheets(sheets), box).surroundings(antenna, (0.0, 1.0, 0.0))
    numerics = check_mode(mode, surroundings)
    scene = build_scene([(mesh.vertices_m, mesh.faces)])
    targets = freeze_target(scene, mesh, chirp, aperture, surroundings, numerics)
    walls = freeze_walls(scene, chirp, aperture, surroundings, numerics)
    belongs_to = _identity(len(mesh.vertices_m), faces, chirp, aperture, box)
    return FrozenScene(mesh.faces, targets, walls, chirp, numerics, belongs_to)


def check_frozen(
    frozen: FrozenScene, num_vertices: int, faces: Any, chirp: Chirp, aperture: Aperture, box: Any
) -> None:
    """Raise RadarError for what was frozen for another scene."""
    given = _identity(num_vertices, faces, chirp, aperture, box)
    held = frozen.belongs_to
    wrong = [name for name, value in given.items() if not np.array_equal(held[name], value)]
    if wrong:
        told = "; ".join(f"{name}: {shown(held[name])}, now {shown(given[name])}" for name in wrong)
        raise RadarError(f"frozen belongs to another scene ({told}): freeze the scene anew")


def check_mode(mode: Any, surroundings: Surroundings) -> Numerics:
    """Settings of the kernels; RadarError for a mode that is none."""
    if isinstance(mode, str) and mode == "fast":
        plain = surroundings.antenna.is_isotropic and not surroundings.occludes
        return DIFFERENTIABLE if plain else DIFFERENTIABLE_THROUGH_WALLS
    if isinstance(mode, Numerics) and not mode.direct:
        return mode
    raise RadarError(
        f"mode of the differentiable model must be 'fast' or a Numerics that is not direct, got {shown(mode)}"
    )


def _mesh(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> SurfaceMesh:
    """The surface as it was given, faces of zero area left out."""
    import trimesh

    checked = load_mesh(trimesh.Trimesh(vertices, faces, process=False))
    edges = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    kept = areas > 1e-9 * areas.max()
    repeated = sum(unique_faces(merge_vertices(vertices, faces)[1][kept])[1:])
    if repeated:
        raise MeshError(
            "mesh.repeated_faces", f"{repeated} faces repeat others or are their backs: give each once"
        )
    return SurfaceMesh(vertices, faces[kept], "vertices", checked.two_sided)


def _identity(num_vertices: int, faces: Any, chirp: Chirp, aperture: Aperture, box: Any) -> dict[str, Any]:
    """What a frozen scene is valid for."""
    return {
        "chirp": chirp,
        "antenna pairs": len(aperture),
        "separate receivers": aperture.rx_m is not None,
        "vertices": num_vertices,
        "faces": coordinates("faces", faces),
        "box": box is not None,
    }
