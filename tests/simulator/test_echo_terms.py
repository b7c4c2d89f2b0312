"""The shared integrand: phasor accuracy, range differences without cancellation, lighting rules."""

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def _variant(mitsuba_variant: None) -> None:
    """Dr.Jit needs its library before the first array."""


def test_phasor_is_exp_of_two_pi_j_turns(rng: np.random.Generator) -> None:
    from waveformer.simulator.device import to_device
    from waveformer.simulator.echo_terms import phasor

    turns = rng.uniform(-50, 50, 20_000).astype(np.float32)
    real, imaginary = phasor(to_device(turns))
    expected = np.exp(2j * np.pi * turns.astype(np.float64))
    # 1.3e-6 of the polynomials, and rounding
    assert np.abs(real.numpy() + 1j * imaginary.numpy() - expected).max() < 2e-6


def test_range_difference_keeps_its_precision_at_any_range(rng: np.random.Generator) -> None:
    from waveformer.simulator.device import to_device, to_device_vectors
    from waveformer.simulator.echo_terms import leg

    point = rng.uniform(-0.1, 0.1, (1000, 3))
    for range_m in (0.3, 20.0):
        antenna = range_m * np.array([0.3, -0.2, np.sqrt(1 - 0.13)])
        tile = np.tile(antenna, (1000, 1))
        way = leg(
            to_device_vectors(tile),
            to_device(np.full(1000, range_m)),
            to_device_vectors(point),
            to_device_vectors(np.tile([0.0, 0.0, 1.0], (1000, 1))),
        )
        exact = np.linalg.norm(antenna - point, axis=1) - np.linalg.norm(antenna)
        # float32 of 0.2 m; a difference of two float32 ranges would lose 1e-6 m at 20 m
        assert np.abs(way.excess_m.numpy() - exact).max() < 5e-8
        assert way.cosine.numpy() == pytest.approx(
            (antenna - point)[:, 2] / np.linalg.norm(antenna - point, axis=1), abs=1e-6
        )


@pytest.mark.parametrize(
    ("tx_z", "rx_z", "two_sided", "lit"),
    [
        (1.0, 1.0, False, True),
        (-1.0, -1.0, False, False),
        (-1.0, -1.0, True, True),
        (1.0, -1.0, False, False),
        (1.0, -1.0, True, False),
    ],
)
def test_a_sample_echoes_only_if_both_antennas_are_on_one_lit_side(
    tx_z: float, rx_z: float, two_sided: bool, lit: bool
) -> None:
    from waveformer.simulator.device import to_device, to_device_vectors
    from waveformer.simulator.echo_terms import echo, leg

    origin, normal = to_device_vectors(np.zeros((1, 3))), to_device_vectors(np.array([[0.0, 0.0, 1.0]]))
    ways = []
    for antenna in ([0.5, 0.0, tx_z], [0.0, 0.3, rx_z]):
        length = to_device(np.array([np.linalg.norm(antenna)]))
        ways.append(leg(to_device_vectors(np.array([antenna])), length, origin, normal))
    amplitude, _, _ = echo(ways[0], ways[1], to_device(np.ones(1)), to_device(np.zeros(1)), two_sided)
    expected = 0.5 * (1 / np.sqrt(1.25) + 1 / np.sqrt(1.09)) / np.sqrt(1.25 * 1.09) if lit else 0.0
    assert amplitude.numpy()[0] == pytest.approx(expected, rel=1e-5)
