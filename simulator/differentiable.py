"""The forward model for torch: the same physics as `simulate`, with gradients.

What is differentiated: lengths, angles and amplitudes of the ways between antennas and surface, through vertices,
antenna positions, matter, occluders, gain and range bias. What is not: which pieces a surface is cut into and which
antenna sees which piece. Both are found once, by `freeze`, and held: a silhouette or a shadow's edge that moves over a
surface does not show in a gradient (docs/inverse_problems.md has the bias by that, measured).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.differentiable_echo import differentiable_echo
from waveformer.simulator.differentiable_imaging import backproject, project
from waveformer.simulator.echo_operator import EchoTerm
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.matter_parameters import Box, Matter, Sheet, changed
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.numerics import DIFFERENTIABLE, DIFFERENTIABLE_THROUGH_WALLS, Numerics
from waveformer.simulator.quadrature import SurfaceSamples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.response_plan import WallChange, constant_response, plan_response
from waveformer.simulator.runtime import activate
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.tessellation import Tessellation

__all__ = ["Box", "FrozenScene", "Sheet", "backproject", "freeze", "project", "simulate", "simulate_drjit"]


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

    mesh = _mesh(_array("vertices", vertices, 3), _array("faces", faces, 3))
    aperture = Aperture(_array("tx_m", tx_m, 3), None if rx_m is None else _array("rx_m", rx_m, 3))
    matter = Matter(None, None, 0.0, _as_tuple(sheets), box)
    surroundings = matter.surroundings(antenna or Antenna.isotropic(), (0.0, 1.0, 0.0))
    numerics = _numerics(mode, surroundings)
    scene = build_scene([(mesh.vertices_m, mesh.faces)])
    targets = freeze_target(scene, mesh, chirp, aperture, surroundings, numerics)
    walls = freeze_walls(scene, chirp, aperture, surroundings, numerics)
    belongs_to = _identity(len(mesh.vertices_m), faces, chirp, aperture, box)
    return FrozenScene(mesh.faces, targets, walls, chirp, numerics, belongs_to)


def simulate(
    vertices: torch.Tensor | ArrayLike,
    faces: torch.Tensor | ArrayLike,
    chirp: Chirp,
    tx_m: torch.Tensor | ArrayLike,
    rx_m: torch.Tensor | ArrayLike | None = None,
    *,
    reflectivity: float | torch.Tensor = 1.0,
    roughness_m: float | torch.Tensor = 0.0,
    permittivity: complex | str | torch.Tensor | None = None,
    thickness_m: float | torch.Tensor | None = None,
    sheets: Sequence[Any] = (),
    box: Any = None,
    antenna: Antenna | None = None,
    antenna_gain_db: float | torch.Tensor = 0.0,
    polarization: Sequence[float] | NDArray[np.float64] = (0.0, 1.0, 0.0),
    range_bias_m: float | torch.Tensor = 0.0,
    mode: str | Numerics = "fast",
    frozen: FrozenScene | None = None,
) -> torch.Tensor:
    """Raw FMCW signal of one surface, differentiable with respect to every argument that is a tensor.

    The physics of `waveformer.simulator.simulate`. A rigid pose is composed in front: ``vertices @ rotation.T + shift``.
    Visibility and tessellation have no derivative (see the module).

    Args:
        vertices: (V, 3), metres, in the radar frame.
        faces: (F, 3) whole numbers.
        chirp: T samples.
        tx_m: transmitters (N, 3).
        rx_m: receivers (N, 3); None means monostatic.
        reflectivity: factor on Gamma, real or complex.
        roughness_m: rms height of the surface.
        permittivity: eps' - j eps'' or a name; None for a perfect conductor.
        thickness_m: of a thin wall; None for a half space.
        sheets: `Sheet` of this module or of `waveformer.simulator`.
        box: `Box` of either; its own echo is added.
        antenna: pattern and gain of both antennas; None means isotropic with 0 dBi.
        antenna_gain_db: what the gain of each antenna exceeds the pattern's by: h grows by twice as many dB.
        polarization: direction of E at both antennas, shape (3,).
        range_bias_m: added to the round-trip path.
        mode: "fast", or a Numerics of the fast kernel.
        frozen: the discrete part from `freeze`; None finds it for the present values.

    Returns:
        Complex64 tensor (N, T) on the device of the vertices.

    Raises:
        MeshError: the mesh cannot be used, or touches or lies behind the aperture.
        RadarError: shapes, numbers or settings make no sense.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    activate()
    if frozen is None:
        frozen = freeze(
            vertices, faces, chirp, tx_m, rx_m, sheets=sheets, box=box, antenna=antenna, mode=mode
        )
    corners = _tensor("vertices", vertices)
    transmitters = _tensor("tx_m", tx_m)
    receivers = None if rx_m is None else _tensor("rx_m", rx_m)
    aperture = Aperture(_host(transmitters), None if receivers is None else _host(receivers))
    _check_frozen(frozen, corners, faces, chirp, aperture, box)
    matter = Matter(permittivity, thickness_m, roughness_m, _as_tuple(sheets), box)
    numbers = list(matter.variables())
    material = matter.material()
    surroundings = matter.surroundings(antenna or Antenna.isotropic(), polarization)
    constant = constant_response(material, surroundings)
    scale = 1j / (4.0 * np.pi) * (1.0 if constant is None else constant)
    h = torch.zeros((len(aperture), chirp.num_samples), dtype=torch.complex64, device=corners.device)
    for target in frozen.targets:
        samples = _samples(corners, frozen, target.pieces)
        placed = _placed(samples, frozen)
        response = None
        if constant is None:
            neighbours = [changed(material, surroundings, change)[:2] for change, _ in numbers]
            response = plan_response(
                material, surroundings, target.surface.crossings, chirp, frozen.numerics.tolerance,
                np.array([placed.points_m.min(axis=0), placed.points_m.max(axis=0)]),
                np.concatenate([aperture.tx_m, aperture.receivers_m]), neighbours=neighbours,
            )  # fmt: skip
        term = target.surface.echo(placed, chirp, aperture, response, scale)
        h = h + differentiable_echo(term, samples, transmitters, receivers, numbers)
    h = h * _scalar("reflectivity", reflectivity, h)
    of_walls = [(change, number) for change, number in numbers if change.wall is not None]
    for echo in _surroundings_echoes(frozen, surroundings, aperture, [change for change, _ in of_walls]):
        h = h + differentiable_echo(echo, None, transmitters, receivers, of_walls)
    gain = 10.0 ** (_scalar("antenna_gain_db", antenna_gain_db, h) / 10.0)
    frequencies = torch.from_numpy(np.array(chirp.frequencies_hz)).to(h.device)
    bias = _scalar("range_bias_m", range_bias_m, h).double()
    turn = torch.exp(-2j * torch.pi / SPEED_OF_LIGHT_M_PER_S * frequencies * bias)
    return (h * gain * turn).to(torch.complex64)


def simulate_drjit(
    vertices: Any, faces: ArrayLike, chirp: Chirp, tx_m: Any, rx_m: Any = None, **settings: Any
) -> Any:
    """The same for Dr.Jit: tensors in, and out the real and imaginary parts, shape (N, T, 2).

    Args:
        vertices, tx_m, rx_m: Dr.Jit tensors (TensorXf) that may carry gradients.
        faces, chirp, settings: as in `simulate`; numbers among the settings may be Dr.Jit arrays.
    """
    activate()
    import drjit as dr

    def in_torch(vertices: Any, tx_m: Any, rx_m: Any, numbers: Any) -> Any:
        scalars = {name: value.reshape(()) for name, value in numbers.items()}
        h = simulate(vertices, faces, chirp, tx_m, rx_m, **constants, **scalars)
        return torch.view_as_real(h)

    numbers = {name: value for name, value in settings.items() if dr.is_array_v(value)}
    constants = {name: value for name, value in settings.items() if name not in numbers}
    return dr.wrap(source="drjit", target="torch")(in_torch)(vertices, tx_m, rx_m, numbers)


def _surroundings_echoes(
    frozen: FrozenScene,
    surroundings: Surroundings,
    aperture: Aperture,
    changes: list[WallChange],
) -> Iterator[EchoTerm]:
    """What the box and the sheets send back themselves."""
    from waveformer.simulator.frozen_surroundings import SheetEcho

    for walls in frozen.walls:
        yield walls.echo(surroundings, frozen.chirp, aperture, changes)
    for place, sheet in enumerate(surroundings.sheets):
        if sheet.echo:
            yield SheetEcho(place, surroundings, frozen.chirp, aperture)


def _samples(vertices: torch.Tensor, frozen: FrozenScene, pieces: Tessellation) -> torch.Tensor:
    """Point, normal, area and taper of every piece, (S, 8) float64, following the vertices."""
    faces = torch.tensor(frozen.faces).to(vertices.device)
    corners = vertices.double()[faces]  # (F, 3, 3)
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    cross = torch.linalg.cross(u, v)
    doubled = torch.linalg.vector_norm(cross, dim=1)
    products = torch.stack([(u * u).sum(1), (u * v).sum(1), (v * v).sum(1)], dim=1)
    face, barycentric, divisor, form = (
        torch.from_numpy(part).to(vertices.device)
        for part in (pieces.face, pieces.barycentric, pieces.divisor, pieces.spread_form)
    )
    points = corners[:, 0][face] + barycentric[:, :1] * u[face] + barycentric[:, 1:] * v[face]
    area = 0.5 * doubled[face] / divisor
    taper = _taper(frozen) * (form * products[face]).sum(1)
    return torch.cat([points, (cross / doubled[:, None])[face], area[:, None], taper[:, None]], dim=1)


def _taper(frozen: FrozenScene) -> float:
    """Taper of a piece with a spread of one square metre."""
    unit = SurfaceSamples(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1), np.ones(1))
    wavelength_m = SPEED_OF_LIGHT_M_PER_S / frozen.chirp.center_hz
    return float(taper_scale(unit, wavelength_m, frozen.numerics.facet_taper)[0])


def _placed(samples: torch.Tensor, frozen: FrozenScene) -> SurfaceSamples:
    """The present values of samples (S, 8)."""
    values = _host(samples)
    scale = _taper(frozen)
    spread = values[:, 7] / scale if scale > 0 else np.zeros(len(values))
    return SurfaceSamples(values[:, :3], values[:, 3:6], values[:, 6], spread)


def _mesh(vertices: NDArray[np.float64], faces: NDArray[np.float64]) -> SurfaceMesh:
    """The surface as it was given, faces of zero area left out."""
    import trimesh

    whole = faces.astype(np.int64)
    if not (whole == faces).all() or len(faces) == 0 or whole.min() < 0 or whole.max() >= len(vertices):
        raise MeshError("mesh.index_range", f"faces must be whole numbers from 0 to {len(vertices) - 1}")
    checked = load_mesh(trimesh.Trimesh(vertices, whole, process=False))
    edges = vertices[whole[:, 1:]] - vertices[whole[:, :1]]
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    return SurfaceMesh(vertices, whole[areas > 1e-9 * areas.max()], "vertices", checked.two_sided)


def _numerics(mode: str | Numerics, surroundings: Surroundings) -> Numerics:
    if mode == "fast":
        plain = surroundings.antenna.is_isotropic and not surroundings.occludes
        return DIFFERENTIABLE if plain else DIFFERENTIABLE_THROUGH_WALLS
    if isinstance(mode, Numerics) and not mode.direct:
        return mode
    raise RadarError(
        f"mode of the differentiable model must be 'fast' or a Numerics that is not direct, got {mode!r}"
    )


def _identity(num_vertices: int, faces: Any, chirp: Chirp, aperture: Aperture, box: Any) -> dict[str, Any]:
    """What a frozen scene is valid for."""
    return {
        "chirp": chirp,
        "antenna pairs": len(aperture),
        "separate receivers": aperture.rx_m is not None,
        "vertices": num_vertices,
        "faces": len(_array("faces", faces, 3)),
        "box": box is not None,
    }


def _check_frozen(
    frozen: FrozenScene, vertices: torch.Tensor, faces: Any, chirp: Chirp, aperture: Aperture, box: Any
) -> None:
    """Refuse what was frozen for another scene."""
    given = _identity(len(vertices), faces, chirp, aperture, box)
    wrong = [name for name, value in given.items() if frozen.belongs_to[name] != value]
    if wrong:
        raise RadarError(
            f"frozen belongs to another scene ({', '.join(wrong)}: {[frozen.belongs_to[name] for name in wrong]}, "
            f"now {[given[name] for name in wrong]}): freeze the scene anew"
        )


def _as_tuple(sheets: Any) -> tuple[Any, ...]:
    if isinstance(sheets, str):
        raise RadarError(f"sheets must be Sheet objects, got {sheets!r}")
    return tuple(sheets) if isinstance(sheets, Sequence) else (sheets,)


def _tensor(name: str, value: Any) -> torch.Tensor:
    """Coordinates (n, 3) as a tensor."""
    tensor = value if isinstance(value, torch.Tensor) else torch.tensor(np.asarray(value, dtype=np.float64))
    if tensor.ndim != 2 or tensor.shape[1] != 3 or not tensor.is_floating_point():
        raise RadarError(
            f"{name} must be real numbers of shape (n, 3), got {tensor.dtype} {tuple(tensor.shape)}"
        )
    if not bool(torch.isfinite(tensor.detach()).all()):
        raise RadarError(f"{name} must be finite")
    return tensor


def _array(name: str, value: Any, columns: int) -> NDArray[np.float64]:
    array = _host(value) if isinstance(value, torch.Tensor) else np.asarray(value, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != columns or not np.isfinite(array).all():
        raise RadarError(f"{name} must be finite numbers of shape (n, {columns}), got {array.shape}")
    return array


def _host(tensor: torch.Tensor) -> NDArray[np.float64]:
    return np.asarray(tensor.detach().cpu().double().numpy())


def _scalar(name: str, value: Any, like: torch.Tensor) -> torch.Tensor:
    tensor = value if isinstance(value, torch.Tensor) else torch.tensor(value)
    if tensor.numel() != 1:
        raise RadarError(f"{name} must be one number, got a tensor of shape {tuple(tensor.shape)}")
    return tensor.to(like.device).reshape(())
