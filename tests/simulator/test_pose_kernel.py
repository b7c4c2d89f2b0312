"""Echoes of a surface in many poses beside the dense float64 sum."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from waveformer.simulator.quadrature import SurfaceSamples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference import dense_echo, integrand
from waveformer.simulator.rigid_pose import RigidPose

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

NODES = Chirp(77.4e9, 3.6e9, 4)
TX_M = np.random.default_rng(1).uniform(-0.1, 0.1, (7, 3)) * [1.0, 1.0, 0.1]
POSES = [
    RigidPose(np.eye(3), np.array([0.01, 0.02, -0.4])).moved(motion)
    for motion in ([0.0] * 6, [0.003, -0.004, 0.002, 0.1, -0.2, 0.3])
]


def body_samples(rng: np.random.Generator, count: int) -> Any:
    from waveformer.simulator.pose_body import BodySamples

    normals = rng.normal(size=(count, 3)) * [0.5, 0.5, 0.2] + [0.0, 0.0, 1.0]
    return BodySamples(
        rng.uniform(-0.05, 0.05, (count, 3)),
        normals / np.linalg.norm(normals, axis=1)[:, None],
        rng.uniform(0.5, 1.0, count) * 1e-5,
        rng.uniform(0.0, 0.3, count),
    )


def placed(samples: Any, pose: RigidPose) -> SurfaceSamples:
    points = samples.points_m @ pose.rotation.T + pose.center_m
    normals = samples.normals @ pose.rotation.T
    return SurfaceSamples(points, normals, samples.areas_m2, np.zeros(len(points)))


def dense(samples: Any, pose: RigidPose) -> np.ndarray:
    everything = np.ones((len(TX_M), len(samples.points_m)), dtype=bool)
    aperture = Aperture(TX_M)
    sums = dense_echo(placed(samples, pose), samples.taper, NODES, aperture, everything, two_sided=False)
    return -1j / (4 * np.pi) * sums


def with_amplitudes_of(samples: Any, pose: RigidPose, motion: np.ndarray) -> np.ndarray:
    """The signal with phases after a motion and amplitudes before it."""
    there, moved = placed(samples, pose), placed(samples, pose.moved(motion))
    rows = []
    for tx in TX_M:
        ways = [
            integrand(at.points_m, at.normals, at.areas_m2, samples.taper, tx, tx, False)
            for at in (there, moved)
        ]
        phase = 4 * np.pi / SPEED_OF_LIGHT_M_PER_S * ways[1][1][:, None] * NODES.frequencies_hz
        rows.append(ways[0][0] @ np.exp(-1j * phase))
    return -1j / (4 * np.pi) * np.array(rows)


def rounding(samples: Any) -> float:
    """Phases are good to 2e-5 rad in float32: 5 cm of range difference at 520 turns a metre, four steps of frequency."""
    return 2e-5 * float(samples.areas_m2.sum()) / 0.3**2 / (4 * np.pi)


@pytest.mark.parametrize("count", [1, 300, 3001])
def test_all_poses_equal_the_dense_sum(rng: np.random.Generator, count: int) -> None:
    from waveformer.simulator.pose_kernel import pose_echoes

    samples = body_samples(rng, count)
    echoes = pose_echoes(samples, POSES, TX_M, NODES)
    assert echoes.shape == (2, 7, 4)
    for pose, echo in zip(POSES, echoes, strict=True):
        expected = dense(samples, pose)
        assert np.abs(expected).max() > 100 * rounding(samples)
        assert np.abs(echo - expected).max() < rounding(samples)


def test_the_signal_beside_the_derivatives_is_the_same(rng: np.random.Generator) -> None:
    from waveformer.simulator.pose_kernel import pose_derivatives, pose_echoes

    samples = body_samples(rng, 500)
    signal, columns = pose_derivatives(samples, POSES[1], TX_M, NODES)
    assert columns.shape == (7, 4, 6)
    assert np.abs(signal - pose_echoes(samples, POSES, TX_M, NODES)[1]).max() < rounding(samples)


def test_the_columns_equal_central_differences_of_the_phase(rng: np.random.Generator) -> None:
    from waveformer.simulator.pose_kernel import pose_derivatives

    samples = body_samples(rng, 300)
    _, columns = pose_derivatives(samples, POSES[1], TX_M, NODES)
    # 4 pi / lambda a metre, and 5 cm of lever: steps turn the phase by 3e-4 rad, so they err by 1e-8
    for axis, step in enumerate(3 * [1e-7] + 3 * [2e-6]):
        motion = step * np.eye(6)[axis]
        ends = [with_amplitudes_of(samples, POSES[1], sign * motion) for sign in (-1, 1)]
        expected = (ends[1] - ends[0]) / (2 * step)
        # float32 as for the signal; rounding of the differences is 1e-16 / 3e-4
        assert np.abs(columns[..., axis] - expected).max() < 2e-4 * np.abs(expected).max(), axis


def test_amplitudes_add_little_to_the_columns(rng: np.random.Generator) -> None:
    from waveformer.simulator.pose_kernel import pose_derivatives

    samples = body_samples(rng, 300)
    upright = replace(samples, normals=np.tile([0.0, 0.0, 1.0], (300, 1)))
    _, columns = pose_derivatives(upright, POSES[0], TX_M, NODES)
    for axis, step in enumerate(3 * [1e-7] + 3 * [2e-6]):
        motion = step * np.eye(6)[axis]
        ends = [dense(upright, POSES[0].moved(sign * motion)) for sign in (-1, 1)]
        expected = (ends[1] - ends[0]) / (2 * step)
        # an amplitude changes by itself over 0.1 m or 1 rad, a phase of 4 pi / lambda over 5 cm turns by 160
        assert np.linalg.norm(columns[..., axis] - expected) < 2e-2 * np.linalg.norm(expected), axis
