"""Known objects found in their own echoes."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from waveformer.simulator import primitives
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.forward import simulate
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.numerics import Numerics
from waveformer.simulator.pose_recovery import PoseFit, recover_pose
from waveformer.simulator.radar import Aperture, Chirp
from waveformer.simulator.rigid_pose import RigidPose
from waveformer.simulator.target import Target

CHIRP = Chirp(77e9, 3.6e9, 16)
APERTURE = Aperture.planar_grid(10, 12, 0.012)


def lump(subdivisions: int) -> trimesh.Trimesh:
    """A smooth lump 5 cm long that looks different from everywhere."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    x, y, z = mesh.vertices.T
    bumps = np.sin(4.0 * x + 1.0) * np.sin(3.0 * y) + 0.7 * np.sin(5.0 * z + 3.0 * x) + 0.5 * np.sin(5.0 * y)
    points = mesh.vertices * (1.0 + 0.15 * bumps)[:, None] * [0.025, 0.018, 0.015]
    return trimesh.Trimesh(points, mesh.faces, process=False)


def true_pose() -> np.ndarray:
    return (
        RigidPose(np.eye(3), np.array([0.004, -0.003, -0.25]))
        .moved([0, 0, 0, 0.2, -0.1, 0.4])
        .matrix(middle())
    )


def middle() -> np.ndarray:
    return np.asarray(lump(3).bounds.mean(axis=0))


@cache
def measured() -> Any:
    """Another tessellation, and noise."""
    mesh = lump(3).subdivide()
    exact = Numerics(spacing_wavelengths=0.3, direct=True, tolerance=1e-5)
    target, noise = Target(mesh, pose=true_pose()), FrontEnd(snr_db=20.0)
    return simulate(target, CHIRP, APERTURE, front_end=noise, mode=exact, seed=4).h


@cache
def first_fit() -> tuple[PoseFit, tuple[str, ...]]:
    """The recovery that several tests look at, and what it told on its way."""
    lines: list[str] = []
    fit = recovered(progress=lines.append)
    return fit, tuple(lines)


def start_pose(shift_m: float, turn_deg: float) -> np.ndarray:
    rng = np.random.default_rng(8)
    shift, turn = (direction / np.linalg.norm(direction) for direction in rng.normal(size=(2, 3)))
    motion = [*(shift_m * shift), *(np.radians(turn_deg) * turn)]
    return RigidPose.of(true_pose(), middle()).moved(motion).matrix(middle())


def recovered(h: Any = None, tx_m: Any = None, pose: Any = None, seed: int = 0, **options: Any) -> PoseFit:
    mesh = lump(3)
    return recover_pose(
        measured() if h is None else h,
        mesh.vertices,
        mesh.faces,
        CHIRP,
        APERTURE.tx_m if tx_m is None else tx_m,
        start_pose(0.003, 4.0) if pose is None else pose,
        seed=seed,
        **options,
    )


@pytest.mark.usefixtures("mitsuba_variant")
def test_a_lump_is_found_in_noise() -> None:
    fit, lines = first_fit()
    shift_m, turn_deg = RigidPose.of(fit.pose, middle()).apart(RigidPose.of(true_pose(), middle()))
    assert shift_m < 2e-4  # what the project asks for
    assert turn_deg < 0.3
    assert fit.agreed
    assert 2 <= fit.runs <= 8
    assert len(lines) == fit.runs + 2
    assert fit.history[-1].pose is fit.pose
    assert [step.stage for step in fit.history][::5] == ["search", "differentiable model"]


@pytest.mark.usefixtures("mitsuba_variant")
def test_a_seed_fixes_the_pose_whatever_the_order_of_the_positions(rng: np.random.Generator) -> None:
    order = rng.permutation(len(APERTURE))
    shuffled = recovered(measured()[order], APERTURE.tx_m[order])
    # rounding: the sums over antennas in another order
    np.testing.assert_allclose(shuffled.pose, first_fit()[0].pose, atol=1e-6)


@pytest.mark.usefixtures("mitsuba_variant")
def test_what_cannot_be_fitted_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(RadarError, match="regular grid"):
        recovered(tx_m=APERTURE.tx_m + rng.uniform(-0.002, 0.002, (len(APERTURE), 3)))
    with pytest.raises(RadarError, match="at least 8 x 8"):
        recovered(measured()[:10], APERTURE.tx_m[:10])
    with pytest.raises(RadarError, match="search_m and search_deg must be positive, got 0 and 3"):
        recovered(search_m=0.0)
    with pytest.raises(RadarError, match="seed"):
        recovered(seed=-1)
    with pytest.raises(MeshError, match="rigid"):
        recovered(pose=np.diag([2.0, 2.0, 2.0, 1.0]))
    with pytest.raises(MeshError, match="behind"):
        recovered(pose=np.eye(4) + 0.3 * np.eye(4, k=1) * [[0], [0], [1], [0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"h": np.ones((100, 15), complex)}, r"h must be complex numbers of shape .* \(100, 16\), got complex128 of"),
        ({"h": [["a"]]}, r"h must be complex numbers of shape"),
        ({"h": np.zeros((100, 16), complex)}, "h is zero everywhere: there is nothing to fit"),
        ({"h": np.full((100, 16), np.nan)}, "h must be finite: 1600 of 1600 samples are NaN or infinite"),
        ({"vertices": "ball.ply"}, "vertices must be real numbers of shape"),
        ({"vertices": [["a", "b", "c"]]}, "vertices must be real numbers of shape"),
        ({"faces": None}, "faces must be real numbers of shape"),
        ({"faces": np.array([[0.5, 1.5, 2.5]])}, "faces must be whole numbers from 0 to"),
        ({"chirp": None}, "chirp must be a Chirp, got None"),
        ({"tx_m": torch.zeros((100, 3), requires_grad=True)}, r"tx_m requires a gradient.*pass tx_m\.detach\(\)"),
        ({"pose": [[1], [1, 2]]}, "pose must be a 4x4 matrix of numbers"),
        ({"search_m": "x"}, "search_m must be one real number, finite, got 'x'"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("mitsuba_variant")
def test_arguments_that_make_no_sense_are_refused(changes: dict[str, Any], message: str) -> None:
    ball = primitives.sphere(0.02, 0.005)
    scene: dict[str, Any] = {
        "h": np.ones((100, 16), complex),
        "vertices": ball.vertices,
        "faces": ball.faces,
        "chirp": CHIRP,
        "tx_m": Aperture.planar_grid(10, 10, 0.01).tx_m,
        "pose": RigidPose(np.eye(3), np.array([0.0, 0.0, -0.3])).matrix(np.zeros(3)),
    } | changes
    search = {name: scene.pop(name) for name in list(scene) if name.startswith("search")}
    with pytest.raises((RadarError, MeshError), match=f"^{message}") as caught:
        recover_pose(*scene.values(), seed=0, **search)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@pytest.mark.usefixtures("mitsuba_variant")
def test_a_clamp_is_found_from_five_millimetres_and_five_degrees(shared_meshes: Path) -> None:
    mesh = trimesh.load(shared_meshes / "ycb/051_large_clamp.ply", process=False)
    center = mesh.bounds.mean(axis=0)
    truth = RigidPose(np.eye(3), np.array([0.0, 0.0, -0.4]))
    aperture, chirp = Aperture.planar_grid(30, 30, 0.008), Chirp(77e9, 3.6e9, 32)
    target = Target(mesh.subdivide(), pose=truth.matrix(center))
    h = simulate(target, chirp, aperture, front_end=FrontEnd(snr_db=20.0), mode="exact", seed=1).h
    rng = np.random.default_rng(3)
    shift, turn = (direction / np.linalg.norm(direction) for direction in rng.normal(size=(2, 3)))
    start = truth.moved([*(0.005 * shift), *(np.radians(5.0) * turn)])
    fit = recover_pose(h, mesh.vertices, mesh.faces, chirp, aperture.tx_m, start.matrix(center), seed=0)
    shift_m, turn_deg = RigidPose.of(fit.pose, center).apart(truth)
    assert fit.agreed
    assert shift_m < 2e-4
    assert turn_deg < 0.3
