"""The forward model for torch: the same physics as `simulate`, with gradients.

What is differentiated: lengths, angles and amplitudes of the ways between antennas and surface, through vertices,
antenna positions, matter, occluders, gain and range bias. What is not: which pieces a surface is cut into and which
antenna sees which piece. Both are found once, by `freeze`, and held: a silhouette or a shadow's edge that moves over a
surface does not show in a gradient (docs/inverse_problems.md has the bias by that, measured).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.arguments import complex_number, coordinates, instance, real_number, shown
from waveformer.simulator.differentiable_echo import differentiable_echo
from waveformer.simulator.differentiable_imaging import backproject, project
from waveformer.simulator.differentiable_rotation import rotation_matrix
from waveformer.simulator.echo_operator import EchoTerm
from waveformer.simulator.errors import RadarError, WaveformerError
from waveformer.simulator.factorisation import taper_scale
from waveformer.simulator.frozen_scene import FrozenScene, check_frozen, check_mode, freeze
from waveformer.simulator.matter_parameters import Box, Matter, Sheet, as_sheets, changed
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.quadrature import SurfaceSamples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.response_plan import WallChange, constant_response, plan_response
from waveformer.simulator.runtime import activate
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.tessellation import Tessellation

__all__ = [
    "Box",
    "FrozenScene",
    "Sheet",
    "backproject",
    "freeze",
    "project",
    "rotation_matrix",
    "simulate",
    "simulate_drjit",
]


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

    The physics of `waveformer.simulator.simulate`. A rigid pose is composed in front: ``vertices @ rotation.T + shift``,
    with `rotation_matrix` of this module.
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
        mode: "fast", or a Numerics of the fast kernel; a frozen scene keeps that it was frozen with.
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
    instance("chirp", chirp, Chirp)
    instance("frozen", frozen, FrozenScene)
    corners = _tensor("vertices", vertices)
    transmitters = _tensor("tx_m", tx_m).to(corners.device)
    receivers = None if rx_m is None else _tensor("rx_m", rx_m).to(corners.device)
    aperture = Aperture(_host(transmitters), None if receivers is None else _host(receivers))
    check_frozen(frozen, len(corners), faces, chirp, aperture, box)
    matter = Matter(permittivity, thickness_m, roughness_m, as_sheets(sheets), box)
    material, surroundings = matter.material(), matter.surroundings(antenna, polarization)
    check_mode(mode, surroundings)
    numbers = list(matter.variables())
    factor = _scalar("reflectivity", reflectivity, corners, complex_number)
    gain_db = _scalar("antenna_gain_db", antenna_gain_db, corners)
    bias_m = _scalar("range_bias_m", range_bias_m, corners).double()
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
    h = h * factor
    of_walls = [(change, number) for change, number in numbers if change.wall is not None]
    for echo in _surroundings_echoes(frozen, surroundings, aperture, [change for change, _ in of_walls]):
        h = h + differentiable_echo(echo, None, transmitters, receivers, of_walls)
    frequencies = torch.from_numpy(np.array(chirp.frequencies_hz)).to(h.device)
    turn = torch.exp(-2j * torch.pi / SPEED_OF_LIGHT_M_PER_S * frequencies * bias_m)
    return (h * 10.0 ** (gain_db / 10.0) * turn).to(torch.complex64)


def simulate_drjit(
    vertices: Any, faces: ArrayLike, chirp: Chirp, tx_m: Any, rx_m: Any = None, **settings: Any
) -> Any:
    """The same for Dr.Jit: tensors in, and out the real and imaginary parts, shape (N, T, 2).

    Args:
        vertices, tx_m, rx_m: Dr.Jit tensors (TensorXf) that may carry gradients.
        faces, chirp, settings: as in `simulate`; real numbers among the settings may be Dr.Jit scalars.

    Raises:
        RadarError: a Dr.Jit setting is no real scalar.
        MeshError, RadarError, SetupError: as `simulate`.
    """
    activate()
    import drjit as dr

    def in_torch(vertices: Any, tx_m: Any, rx_m: Any, numbers: Any) -> Any:
        scalars = {name: value.reshape(()) for name, value in numbers.items()}
        h = simulate(vertices, faces, chirp, tx_m, rx_m, **constants, **scalars)
        return torch.view_as_real(h)

    numbers = {name: value for name, value in settings.items() if dr.is_array_v(value)}
    for name, value in numbers.items():
        if dr.is_complex_v(value) or not dr.is_float_v(value) or dr.prod(dr.shape(value)) != 1:
            raise RadarError(
                f"{name} must be a real scalar of Dr.Jit, got {shown(value)}: use the form for torch"
            )
    constants = {name: value for name, value in settings.items() if name not in numbers}
    try:
        return dr.wrap(source="drjit", target="torch")(in_torch)(vertices, tx_m, rx_m, numbers)
    except RuntimeError as error:
        # Dr.Jit hides what a wrapped function raises behind an error of its own
        if isinstance(error.__cause__, WaveformerError):
            raise error.__cause__ from None
        raise


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
    # a face that collapses has no normal, but no area either: neither may spoil a gradient
    normals = cross / doubled.clamp(min=1e-30)[:, None]
    products = torch.stack([(u * u).sum(1), (u * v).sum(1), (v * v).sum(1)], dim=1)
    face, barycentric, divisor, form = (
        torch.from_numpy(part).to(vertices.device)
        for part in (pieces.face, pieces.barycentric, pieces.divisor, pieces.spread_form)
    )
    points = corners[:, 0][face] + barycentric[:, :1] * u[face] + barycentric[:, 1:] * v[face]
    area = 0.5 * doubled[face] / divisor
    taper = _taper(frozen) * (form * products[face]).sum(1)
    return torch.cat([points, normals[face], area[:, None], taper[:, None]], dim=1)


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


def _tensor(name: str, value: Any) -> torch.Tensor:
    """Coordinates (n, 3) as a tensor, a tensor as it is."""
    checked = coordinates(name, value)
    return (
        value if isinstance(value, torch.Tensor) and value.is_floating_point() else torch.from_numpy(checked)
    )


def _host(tensor: torch.Tensor) -> NDArray[np.float64]:
    return np.asarray(tensor.detach().cpu().double().numpy())


def _scalar(
    name: str, value: Any, like: torch.Tensor, check: Callable[[str, Any], complex] = real_number
) -> torch.Tensor:
    """One number as a scalar tensor on the same device."""
    plain = check(name, value)
    tensor = value if isinstance(value, torch.Tensor) else torch.tensor(plain)
    return tensor.to(like.device).reshape(())
