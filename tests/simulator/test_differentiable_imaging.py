"""Gradients of the image: the adjoint through torch, and finite differences of Eq. 1 in float64."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import torch
from torch.autograd import forward_ad

from waveformer.simulator import imaging
from waveformer.simulator.differentiable_imaging import backproject, project
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference import dense_backproject, dense_project

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77e9, 4e9, 16)
PLANE = Aperture.planar_grid(5, 4, 0.006)
PAIRS = Aperture(PLANE.tx_m, PLANE.tx_m + [0.02, -0.01, 0.0])
APERTURES = pytest.mark.parametrize("aperture", [PLANE, PAIRS], ids=["monostatic", "pairs"])
GRID = Grid.box([-0.015, -0.02, -0.32], [0.015, 0.02, -0.30], 0.005)
SHAPE = (len(PLANE), CHIRP.num_samples)
BIAS_M = 0.0123


def noise(rng: np.random.Generator, *shape: int) -> torch.Tensor:
    return torch.from_numpy((rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64))


def inner(one: torch.Tensor, other: torch.Tensor) -> torch.Tensor:
    """<one, other>, summed in float64."""
    return (one.to(torch.complex128).conj() * other.to(torch.complex128)).sum()


def difference(one: torch.Tensor, other: torch.Tensor) -> float:
    return float((one - other).abs().max() / other.abs().max())


def positions(aperture: Aperture) -> tuple[Any, Any]:
    return aperture.tx_m, aperture.rx_m


def dense_image(h: np.ndarray, aperture: Aperture, bias_m: float) -> np.ndarray:
    turn = np.exp(2j * np.pi * CHIRP.frequencies_hz * bias_m / SPEED_OF_LIGHT_M_PER_S)
    return dense_backproject(h * turn, CHIRP, aperture, GRID)


@APERTURES
def test_values_are_those_of_imaging(rng: np.random.Generator, aperture: Aperture) -> None:
    tx_m, rx_m = positions(aperture)
    h, image = noise(rng, *SHAPE), noise(rng, *GRID.shape)
    there = backproject(h, CHIRP, tx_m, GRID, rx_m, range_bias_m=BIAS_M)
    assert (there.dtype, tuple(there.shape)) == (torch.complex64, GRID.shape)
    expected = imaging.backproject(Measurement(h.numpy(), CHIRP, aperture, range_bias_m=BIAS_M), GRID)
    assert difference(there, torch.from_numpy(expected)) < 1e-6  # the same code, float32
    back = project(image, GRID, CHIRP, tx_m, rx_m)
    assert (back.dtype, tuple(back.shape)) == (torch.complex64, SHAPE)
    expected = imaging.project(image.numpy(), GRID, CHIRP, aperture)
    assert difference(back, torch.from_numpy(expected)) < 1e-6  # the same code, float32


@APERTURES
@pytest.mark.parametrize("bias_m", [0.0, BIAS_M])
def test_the_gradient_is_the_adjoint(rng: np.random.Generator, aperture: Aperture, bias_m: float) -> None:
    tx_m, rx_m = positions(aperture)
    h, image = noise(rng, *SHAPE).requires_grad_(), noise(rng, *GRID.shape)
    # h drawn towards the image's echo, so that the inner product stands out of its terms
    turn = np.exp(-2j * np.pi * CHIRP.frequencies_hz * bias_m / SPEED_OF_LIGHT_M_PER_S)
    echo = project(image, GRID, CHIRP, tx_m, rx_m) * torch.from_numpy(turn)
    there = backproject(h + echo / 10, CHIRP, tx_m, GRID, rx_m, range_bias_m=bias_m)
    product = inner(image, there)
    (gradient,) = torch.autograd.grad(product.real, h)
    with torch.no_grad():
        # <x, A* y> = <A x, y>, once with the gradient of Re <x, A* y> for A x, once with the operator itself
        for forward in (gradient, echo):
            assert abs(inner(forward, h + echo / 10) - product) < 1e-5 * abs(product)  # float32


@APERTURES
def test_the_gradient_of_projection_is_backprojection(rng: np.random.Generator, aperture: Aperture) -> None:
    tx_m, rx_m = positions(aperture)
    image, h = noise(rng, *GRID.shape).requires_grad_(), noise(rng, *SHAPE)
    (gradient,) = torch.autograd.grad(inner(h, project(image, GRID, CHIRP, tx_m, rx_m)).real, image)
    assert difference(gradient, backproject(h, CHIRP, tx_m, GRID, rx_m)) < 1e-6  # the same code, float32


@APERTURES
@pytest.mark.parametrize("bias_m", [0.0, BIAS_M])
def test_the_gradient_of_a_loss_on_the_image_against_finite_differences(
    rng: np.random.Generator, aperture: Aperture, bias_m: float
) -> None:
    tx_m, rx_m = positions(aperture)
    h, weight, aim = noise(rng, *SHAPE).requires_grad_(), rng.random(GRID.shape), noise(rng, *GRID.shape)
    image = backproject(h, CHIRP, tx_m, GRID, rx_m, range_bias_m=bias_m)
    # a power alone would not notice a common phase
    loss = (torch.from_numpy(weight) * image.abs() ** 2).sum() + 10 * (aim * image).real.sum()
    (gradient,) = torch.autograd.grad(loss, h)

    def exact_loss(at: np.ndarray) -> float:
        dense = dense_image(at, aperture, bias_m)
        return float((weight * np.abs(dense) ** 2).sum() + 10 * (aim.numpy() * dense).real.sum())

    at = h.detach().numpy().astype(complex)
    for row, sample in ((0, 0), (7, 3), (19, 15)):
        for unit in (1.0, 1.0j):
            step = np.zeros(SHAPE, complex)
            step[row, sample] = unit
            # the loss is quadratic, so the difference is exact at any step
            slope = (exact_loss(at + step) - exact_loss(at - step)) / 2
            told = (gradient[row, sample].conj() * unit).real.item()
            # imaging.TOLERANCE of a term, twice: the image and its projection
            assert told == pytest.approx(slope, abs=2e-3 * float(gradient.abs().max()))


@APERTURES
def test_the_gradient_of_a_loss_on_the_echo_against_finite_differences(
    rng: np.random.Generator, aperture: Aperture
) -> None:
    tx_m, rx_m = positions(aperture)
    image, aim = noise(rng, *GRID.shape).requires_grad_(), noise(rng, *SHAPE) * 10
    loss = ((project(image, GRID, CHIRP, tx_m, rx_m) - aim).abs() ** 2).sum()
    (gradient,) = torch.autograd.grad(loss, image)

    def exact_loss(at: np.ndarray) -> float:
        return float((np.abs(dense_project(at, GRID, CHIRP, aperture) - aim.numpy()) ** 2).sum())

    at = image.detach().numpy().astype(complex)
    for voxel in ((0, 0, 0), (3, 5, 2), (6, 8, 4)):
        for unit in (1.0, 1.0j):
            step = np.zeros(GRID.shape, complex)
            step[voxel] = unit
            slope = (exact_loss(at + step) - exact_loss(at - step)) / 2
            told = (gradient[voxel].conj() * unit).real.item()
            # imaging.TOLERANCE of a term, twice: the echo and its image
            assert told == pytest.approx(slope, abs=2e-3 * float(gradient.abs().max()))


def test_the_gradient_of_a_gradient(rng: np.random.Generator) -> None:
    h, along = noise(rng, *SHAPE).requires_grad_(), noise(rng, *SHAPE)
    image = backproject(h, CHIRP, PLANE.tx_m, GRID, range_bias_m=BIAS_M)
    (gradient,) = torch.autograd.grad((image.abs() ** 2).sum(), h, create_graph=True)
    (curvature,) = torch.autograd.grad(inner(along, gradient).real, h)
    # the gradient of |A* h|^2 is 2 A A* h, itself linear in h and its own adjoint
    other = along.clone().requires_grad_()
    power = (backproject(other, CHIRP, PLANE.tx_m, GRID, range_bias_m=BIAS_M).abs() ** 2).sum()
    (expected,) = torch.autograd.grad(power, other)
    assert difference(curvature, expected) < 1e-5  # float32


def test_conjugate_views_count_as_what_they_stand_for(rng: np.random.Generator) -> None:
    h = noise(rng, *SHAPE)
    view, whole = h.conj(), h.conj().resolve_conj().clone()
    assert view.is_conj()
    images = [backproject(values, CHIRP, PLANE.tx_m, GRID) for values in (view, whole)]
    assert torch.equal(*images)


def test_gradients_have_the_type_of_the_input(rng: np.random.Generator) -> None:
    h = noise(rng, *SHAPE).to(torch.complex128).requires_grad_()
    image = backproject(h, CHIRP, torch.from_numpy(PLANE.tx_m.copy()), GRID)
    assert image.dtype == torch.complex64
    image.abs().sum().backward()
    assert h.grad is not None
    assert (h.grad.dtype, h.grad.device) == (h.dtype, h.device)
    assert h.grad.abs().max() > 0


@pytest.mark.parametrize(
    ("h", "message"),
    [
        (np.zeros(SHAPE, np.complex64), "h must be a torch tensor, got ndarray"),
        (torch.zeros(SHAPE), "h must be complex, got torch.float32"),
        (torch.zeros(SHAPE[::-1], dtype=torch.complex64), r"h must have shape \(20, 16\), got \(16, 20\)"),
        (
            torch.full(SHAPE, torch.nan, dtype=torch.complex64),
            "h holds 320 values that are NaN or infinite, of 320: set them to zero",
        ),
    ],
)
def test_what_is_no_scan_is_refused(h: Any, message: str) -> None:
    with pytest.raises(RadarError, match=f"^{message}$"):
        backproject(h, CHIRP, PLANE.tx_m, GRID)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (torch.zeros(GRID.shape), "image must be complex"),
        (torch.zeros((2, 2, 2), dtype=torch.complex64), "image must have shape"),
        (
            torch.full(GRID.shape, torch.inf, dtype=torch.complex64),
            "image holds [0-9]+ values that are NaN or infinite",
        ),
    ],
)
def test_what_is_no_image_is_refused(image: torch.Tensor, message: str) -> None:
    with pytest.raises(RadarError, match=f"^{message}"):
        project(image, GRID, CHIRP, PLANE.tx_m)


def test_a_gradient_that_would_be_lost_is_refused(rng: np.random.Generator) -> None:
    h, tx_m = noise(rng, *SHAPE), torch.from_numpy(PLANE.tx_m.copy()).requires_grad_()
    with pytest.raises(RadarError, match=r"tx_m requires a gradient.*pass tx_m\.detach\(\)"):
        backproject(h, CHIRP, tx_m, GRID)
    with pytest.raises(RadarError, match="rx_m requires a gradient"):
        backproject(h, CHIRP, PLANE.tx_m, GRID, tx_m)
    with pytest.raises(RadarError, match="range_bias_m requires a gradient"):
        backproject(h, CHIRP, PLANE.tx_m, GRID, range_bias_m=torch.tensor(0.1, requires_grad=True))


def test_a_forward_derivative_is_linear_and_that_of_a_position_is_refused(rng: np.random.Generator) -> None:
    h, motion = noise(rng, *SHAPE), noise(rng, *SHAPE)
    tx_m = torch.from_numpy(PLANE.tx_m.copy())
    with forward_ad.dual_level():
        image = backproject(forward_ad.make_dual(h, motion), CHIRP, PLANE.tx_m, GRID)
        moved = forward_ad.unpack_dual(image).tangent
        scan = forward_ad.unpack_dual(project(image, GRID, CHIRP, PLANE.tx_m)).tangent
        with pytest.raises(RadarError, match="tx_m requires a gradient"):
            backproject(h, CHIRP, forward_ad.make_dual(tx_m, torch.ones_like(tx_m)), GRID)
    assert torch.equal(moved, backproject(motion, CHIRP, PLANE.tx_m, GRID))
    assert torch.equal(scan, project(moved, GRID, CHIRP, PLANE.tx_m))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"range_bias_m": float("nan")}, "range_bias_m must be one real number, finite, got nan"),
        ({"range_bias_m": float("inf")}, "range_bias_m must be one real number, finite, got inf"),
        ({"range_bias_m": "x"}, "range_bias_m must be one real number, finite, got 'x'"),
        ({"grid": None}, "grid must be a Grid, got None"),
        ({"chirp": None}, "chirp must be a Chirp, got None"),
    ],
)
def test_settings_that_make_no_sense_are_refused(
    rng: np.random.Generator, changes: dict[str, Any], message: str
) -> None:
    scan = {"chirp": CHIRP, "tx_m": PLANE.tx_m, "grid": GRID}
    with pytest.raises(RadarError, match=f"^{message}$"):
        backproject(noise(rng, *SHAPE), **(scan | changes))
    if "range_bias_m" not in changes:
        with pytest.raises(RadarError, match=f"^{message}$"):
            project(torch.zeros(GRID.shape, dtype=torch.complex64), **(scan | changes))


def test_a_broken_gradient_is_named(rng: np.random.Generator) -> None:
    h = noise(rng, *SHAPE).requires_grad_()
    image = backproject(h, CHIRP, PLANE.tx_m, GRID)
    with pytest.raises(RadarError, match=r"gradient .* holds non-finite values"):
        (image.abs().sum() * torch.nan).backward()


def test_the_package_itself_does_not_load_torch() -> None:
    code = "import sys, waveformer.simulator, waveformer.simulator.imaging; assert 'torch' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
