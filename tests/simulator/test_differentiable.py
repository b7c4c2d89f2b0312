"""Gradients of the differentiable model against central differences of its float64 twin, and its edges."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from torch.autograd import forward_ad

from waveformer.simulator import adjoint_echo, kernel_adjoint, primitives, tangent_echo
from waveformer.simulator.antenna import Antenna
from waveformer.simulator.differentiable import Sheet, simulate, simulate_drjit
from waveformer.simulator.errors import RadarError
from waveformer.simulator.numerics import DIFFERENTIABLE
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.reference_gradient import GradientCase

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 3.6e9, 11)  # as far as 0.46 m
GRID = Aperture.planar_grid(6, 6, 0.006).tx_m  # enough for nodes between antennas
FEW = Aperture.planar_grid(2, 2, 0.03).tx_m
OFFSET = np.array([0.02, -0.01, 0.0])
# As far as 0.4 m: the logarithm of what lies on a way is linear over a cell to this.
PATH_TOLERANCE = 2e-4
WALL = (2.2 - 0.05j, 0.004)
# The twin needs a while for matter. How finely a surface is cut does not matter for what is compared.
COARSE = DIFFERENTIABLE.model_copy(update={"spacing_wavelengths": 0.7})
SURFACE = ("reflectivity", "antenna_gain_db", "range_bias_m")


def blob() -> tuple[np.ndarray, np.ndarray]:
    """A smooth closed body without symmetry, 16 mm long."""
    mesh = primitives.sphere(0.008, 0.0022)
    vertices = np.array(mesh.vertices)
    x, y, _ = vertices.T * 180
    bumps = np.sin(5 * x + 1) * np.sin(4 * y) + 0.5 * np.sin(9 * y)
    vertices = vertices * (1 + 0.1 * bumps)[:, None] * [1.0, 0.8, 0.6]
    return vertices + np.array([0.005, 0.003, -0.4]), np.array(mesh.faces)


def ball_over_a_plate() -> tuple[np.ndarray, np.ndarray]:
    """An open surface that reflects on both sides and shadows itself."""
    ball, plate = primitives.sphere(0.004, 0.0015), primitives.plate(0.018, 0.015, 0.003)
    ball.apply_translation([0, 0, 0.008])
    plate.vertices[:, 2] += 0.001 * np.sin(300 * plate.vertices[:, 0])
    mesh = trimesh.util.concatenate([ball, plate])
    return np.array(mesh.vertices) + np.array([0.004, 0.002, -0.41]), np.array(mesh.faces)


def difference(one: Any, other: Any) -> float:
    return float(np.linalg.norm(np.asarray(one) - np.asarray(other)) / np.linalg.norm(np.asarray(other)))


@pytest.mark.parametrize("make", [blob, ball_over_a_plate])
@pytest.mark.parametrize("offset", [None, OFFSET], ids=["monostatic", "pairs"])
def test_vertices_and_antennas(make: Any, offset: Any) -> None:
    case = GradientCase(*make(), CHIRP, GRID, None if offset is None else GRID + offset)
    (target,) = case.frozen.targets
    assert all(work.tile.weights is not None for work in target.surface.tiles)
    assert target.surface.two_sided == (make is ball_over_a_plate)
    # float32 where samples are many, and tolerance of the interpolations, see numerics.DIFFERENTIABLE
    assert difference(case.fast().numpy(), case.exact()) < 1e-4
    assert case.misses("vertices", "tx_m", *SURFACE, *([] if offset is None else ["rx_m"])) == {}


def test_matter() -> None:
    matter: dict[str, Any] = {"permittivity": 3 - 0.2j, "thickness_m": 0.003, "roughness_m": 2e-4}
    case = GradientCase(*blob(), CHIRP, FEW, FEW + OFFSET, **matter, mode=COARSE)
    assert difference(case.fast().numpy(), case.exact()) < 1e-4  # as above
    assert case.misses("vertices", "tx_m", "rx_m", *matter, *SURFACE) == {}


def test_an_antenna_pattern() -> None:
    case = GradientCase(*blob(), CHIRP, FEW, antenna=Antenna.from_preset("iwr1443"), mode=COARSE)
    assert difference(case.fast().numpy(), case.exact()) < PATH_TOLERANCE
    assert case.misses("vertices", "tx_m", *SURFACE) == {}


def test_through_a_sheet() -> None:
    case = GradientCase(*blob(), CHIRP, FEW, roughness_m=2e-4, sheet=WALL, mode=COARSE)
    assert difference(case.fast().numpy(), case.exact()) < PATH_TOLERANCE
    assert case.misses("vertices", "tx_m", "sheet permittivity", "sheet thickness_m", "roughness_m") == {}


@pytest.mark.parametrize("sheet", [None, WALL], ids=["open", "sheet"])
def test_an_isotropic_gain_with_matter(sheet: Any) -> None:
    antenna = Antenna.isotropic(10.0)
    case = GradientCase(*blob(), CHIRP, FEW, permittivity=3 - 0.2j, sheet=sheet, antenna=antenna, mode=COARSE)
    assert difference(case.fast().numpy(), case.exact()) < PATH_TOLERANCE
    assert case.misses("vertices", "tx_m", "permittivity") == {}


def test_a_sheet_with_an_echo() -> None:
    around: dict[str, Any] = {"sheet": WALL, "sheet_echo": True, "mode": COARSE}
    case = GradientCase(*blob(), CHIRP, FEW, FEW + OFFSET, permittivity=3 - 0.2j, **around)
    assert difference(case.fast().numpy(), case.exact()) < PATH_TOLERANCE
    assert case.misses("rx_m", "permittivity", "sheet permittivity", "sheet thickness_m") == {}


def test_through_the_walls_of_a_box() -> None:
    case = GradientCase(*blob(), CHIRP, FEW, permittivity=3 - 0.2j, box=WALL, mode=COARSE)
    assert difference(case.fast().numpy(), case.exact()) < PATH_TOLERANCE
    assert case.misses("tx_m", "permittivity", "box permittivity", "box thickness_m", *SURFACE) == {}


FORWARD: dict[str, tuple[dict[str, Any], dict[str, float]]] = {
    "geometry": (
        {},
        {"vertices": 1e-5, "tx_m": 1e-5, "rx_m": 1e-5, "reflectivity": 0.1, "range_bias_m": 1e-5},
    ),
    "matter": ({"permittivity": 3 - 0.2j, "roughness_m": 2e-4}, {"permittivity": 0.1, "roughness_m": 1e-5}),
}


@pytest.mark.parametrize("kind", FORWARD)
def test_forward_mode_is_the_transposed_of_backward_mode(rng: np.random.Generator, kind: str) -> None:
    matter, sizes = FORWARD[kind]
    case = GradientCase(*ball_over_a_plate(), CHIRP, GRID, GRID + OFFSET, **matter)
    weight = torch.from_numpy(rng.normal(size=(36, 11)) + 1j * rng.normal(size=(36, 11))).to(torch.complex64)
    tensors = {name: torch.tensor(case.numbers[name]) for name in sizes}
    leaves = {name: tensor.clone().requires_grad_() for name, tensor in tensors.items()}
    h = case.fast(**leaves)
    (weight.conj() * h).real.sum().backward()
    scale = float(torch.linalg.vector_norm(weight) * torch.linalg.vector_norm(h.detach()))
    for name, size in sizes.items():
        direction = size * torch.from_numpy(np.asarray(rng.normal(size=tuple(tensors[name].shape))))
        with forward_ad.dual_level():
            dual = forward_ad.make_dual(tensors[name], direction.to(tensors[name].dtype))
            tangent = forward_ad.unpack_dual(case.fast(**{name: dual})).tangent
        forwards = float((weight.conj() * tangent).real.sum())
        backwards = float((leaves[name].grad.conj() * direction).real.sum())
        # both in float32 with other orders of summation; a random weight makes the terms cancel
        assert forwards == pytest.approx(backwards, rel=1e-3, abs=1e-6 * scale), name


def _conjugated(original: Any) -> Any:
    return lambda *inputs: np.conj(original(*inputs))


def _negated(place: int) -> Callable[[Any], Any]:
    def plant(original: Any) -> Any:
        def wrong(*inputs: Any) -> Any:
            parts = list(original(*inputs))
            parts[place] = -parts[place]
            return tuple(parts)

        return wrong

    return plant


def _conjugated_pairs(original: Any) -> Any:
    """Real and imaginary parts in turn, the latter negated."""

    def wrong(*inputs: Any) -> Any:
        moments = np.array(original(*inputs))
        moments[1::2] *= -1
        return moments

    return wrong


PLANTS: dict[str, tuple[Any, str, Any, str]] = {
    "carrier": (kernel_adjoint, "_moment_adjoint", _negated(2), "vertices"),
    "range in the cell": (kernel_adjoint, "_moment_adjoint", _negated(3), "vertices"),
    "amplitude": (kernel_adjoint, "_moment_adjoint", _negated(0), "vertices"),
    "reference phase": (adjoint_echo, "reference_phase", _conjugated, "vertices"),
    "moments at antennas": (adjoint_echo, "collect_cells", _conjugated_pairs, "vertices"),
    "motion of the reference": (tangent_echo, "_closing_speed", lambda old: lambda *a: -old(*a), "tx_m"),
}


@pytest.mark.parametrize("name", PLANTS)
def test_a_wrong_sign_is_seen(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    module, function, plant, number = PLANTS[name]
    case = GradientCase(*ball_over_a_plate(), CHIRP, FEW)
    assert case.misses(number) == {}
    monkeypatch.setattr(module, function, plant(getattr(module, function)))
    assert case.misses(number) != {}


def test_gradcheck() -> None:
    """The operation against differences of its own values: forward and backward, several inputs at once."""
    case = GradientCase(*blob(), CHIRP, FEW, roughness_m=2e-4)
    vertices, scale = torch.from_numpy(case.vertices), float(np.abs(case.exact()).max())
    one = torch.ones((), dtype=torch.float64, requires_grad=True)
    zero = torch.zeros(3, dtype=torch.float64, requires_grad=True)

    def signal(shift: torch.Tensor, reflectivity: torch.Tensor, gain: torch.Tensor) -> torch.Tensor:
        moved = vertices + 1e-4 * shift
        h = case.fast(
            vertices=moved, reflectivity=reflectivity, antenna_gain_db=gain[0], range_bias_m=gain[1] * 1e-4
        )
        return torch.view_as_real(h / scale).double()

    # differences of float32 values: 1e-6 over a step of 1e-2, and a third of its square
    assert torch.autograd.gradcheck(
        signal, (zero, one, zero.detach().clone().requires_grad_()), eps=1e-2, atol=1e-3, rtol=1e-3,
        fast_mode=True, check_forward_ad=True,
    )  # fmt: skip


def test_no_gradient_is_needed() -> None:
    vertices, faces = blob()
    h = simulate(vertices, faces, CHIRP, FEW)
    assert (h.dtype, tuple(h.shape), h.requires_grad) == (torch.complex64, (4, 11), False)
    gain = torch.zeros((), requires_grad=True)
    again = simulate(torch.from_numpy(vertices), torch.from_numpy(faces), CHIRP, FEW, antenna_gain_db=gain)
    assert torch.equal(again, h)
    again.abs().sum().backward()
    assert gain.grad is not None


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradients_have_the_type_of_the_input(dtype: torch.dtype) -> None:
    case = GradientCase(*blob(), CHIRP, FEW)
    vertices, tx_m = (torch.tensor(array, dtype=dtype, requires_grad=True) for array in (case.vertices, FEW))
    case.loss(case.fast(vertices=vertices, tx_m=tx_m)).backward()
    for tensor in (vertices, tx_m):
        assert tensor.grad is not None
        assert (tensor.grad.dtype, tensor.grad.shape) == (dtype, tensor.shape)
    # 0.4 m in float32 is good to 1.5e-8 m, 5e-5 rad of phase, which turns the small difference from the aim
    assert difference(vertices.grad, case.gradients("vertices")["vertices"]) < 1e-3


def test_a_frozen_scene_is_used_again() -> None:
    case = GradientCase(*ball_over_a_plate(), CHIRP, GRID)
    fresh = simulate(case.vertices, case.faces, CHIRP, GRID)
    assert torch.equal(fresh, case.fast())
    near = torch.from_numpy(case.vertices + np.array([2e-4, -1e-4, 3e-4]))
    # the pieces at the edge of a shadow, and where the surface turns away: a share of the order of shift / length
    assert difference(case.fast(vertices=near), simulate(near, case.faces, CHIRP, GRID)) < 2e-2


def test_matter_that_does_not_matter_has_a_gradient_of_zero() -> None:
    case = GradientCase(*blob(), CHIRP, FEW, roughness_m=0.0)
    # exp(-x^2) is flat at a perfectly smooth surface
    assert case.gradients("roughness_m")["roughness_m"] == 0


def test_permittivities_may_be_real_or_views() -> None:
    case = GradientCase(*blob(), CHIRP, FEW, permittivity=3 - 0.2j)
    whole = case.gradients("permittivity")["permittivity"]
    eps = torch.tensor(3 + 0.2j, dtype=torch.complex128, requires_grad=True)
    case.loss(case.fast(permittivity=eps.conj())).backward()
    assert eps.grad is not None
    assert eps.grad.conj().resolve_conj().item() == pytest.approx(complex(whole), rel=1e-5)
    real = torch.tensor(3.0, requires_grad=True)
    case.loss(case.fast(permittivity=real - 0.2j)).backward()
    assert real.grad is not None
    assert real.grad.item() == pytest.approx(float(whole.real), rel=1e-5)
    lossless = torch.tensor(3.0, requires_grad=True)
    case.loss(case.fast(permittivity=lossless)).backward()
    both = torch.tensor(3.0 + 0.0j, requires_grad=True)
    case.loss(case.fast(permittivity=both)).backward()
    assert lossless.grad is not None
    assert both.grad is not None
    # the same number as the real part of a complex one, which does not matter nothing
    assert lossless.grad.item() == pytest.approx(both.grad.real.item(), rel=1e-5)
    assert abs(lossless.grad.item()) > 1e-2


@pytest.mark.parametrize("permittivity", [3 + 0j, 2.05 - 0.0004j])
def test_matter_may_be_lossless(permittivity: complex) -> None:
    vertices, faces = blob()
    eps, wall = (torch.tensor(permittivity, dtype=torch.complex128, requires_grad=True) for _ in range(2))
    for echo in (False, True):
        sheet = Sheet((0, 0, -0.12), (0, 0, 1), 0.004, wall, echo)
        h = simulate(vertices, faces, CHIRP, FEW, permittivity=eps, sheets=sheet)
        for gradient in torch.autograd.grad((h.abs() ** 2).sum(), (eps, wall)):
            assert gradient.real != 0
            assert gradient.imag != 0


def test_second_derivatives_are_refused() -> None:
    vertices, faces = blob()
    shift = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    h = simulate(torch.from_numpy(vertices) + shift, faces, CHIRP, FEW)
    with pytest.raises(RadarError, match="no second derivatives: call backward without create_graph"):
        torch.autograd.grad((h.abs() ** 2).sum(), shift, create_graph=True)


def test_a_face_that_collapses_leaves_the_gradient_finite() -> None:
    case = GradientCase(*ball_over_a_plate(), CHIRP, FEW)
    lit = case.frozen.faces[np.bincount(case.frozen.targets[0].pieces.face).argmax()]
    vertices = np.array(case.vertices)
    vertices[lit[1]] = vertices[lit[0]]
    leaf = torch.tensor(vertices, requires_grad=True)
    h = case.fast(vertices=leaf)
    (h.abs() ** 2).sum().backward()
    assert torch.isfinite(torch.view_as_real(h)).all()
    assert leaf.grad is not None
    assert torch.isfinite(leaf.grad).all()
    assert leaf.grad.abs().max() > 0


def test_the_form_for_drjit() -> None:
    import drjit as dr
    from drjit.auto.ad import Float, TensorXf

    case = GradientCase(*blob(), CHIRP, FEW, roughness_m=2e-4)
    weight = torch.randn((4, 11, 2), generator=torch.Generator().manual_seed(0))
    names = ("vertices", "tx_m", "roughness_m")
    leaves = {
        name: torch.tensor(case.numbers[name], dtype=torch.float32, requires_grad=True) for name in names
    }
    expected = torch.view_as_real(case.fast(**leaves))
    (expected * weight).sum().backward()
    vertices, tx_m = (TensorXf(np.asarray(case.numbers[name], dtype=np.float32)) for name in names[:2])
    roughness = Float(case.numbers["roughness_m"])
    dr.enable_grad(vertices, tx_m, roughness)
    h = simulate_drjit(vertices, case.faces, CHIRP, tx_m, roughness_m=roughness, frozen=case.frozen)
    assert h.shape == (4, 11, 2)
    assert difference(h.numpy(), expected.detach()) < 1e-6  # the same code
    dr.backward(dr.sum(h * TensorXf(weight.numpy())))
    for name, array in zip(names, (vertices, tx_m, roughness), strict=True):
        told = dr.grad(array).numpy().reshape(leaves[name].shape)
        assert difference(told, leaves[name].grad) < 1e-5, name  # the same code
