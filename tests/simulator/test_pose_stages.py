"""Parts of the signal that the stages of a pose recovery work on."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator.errors import RadarError
from waveformer.simulator.pose_stages import averaged_frequencies
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

CHIRP = Chirp(77e9, 3.6e9, 16)


@pytest.mark.parametrize("num_nodes", [2, 4])
def test_averaged_frequencies_keep_an_echo_from_the_middle(num_nodes: int) -> None:
    h = np.exp(-4j * np.pi * 0.3 * CHIRP.frequencies_hz / SPEED_OF_LIGHT_M_PER_S)[None]
    nodes, means = averaged_frequencies(h, CHIRP, num_nodes, 0.3)
    expected = np.exp(-4j * np.pi * 0.3 * nodes.frequencies_hz / SPEED_OF_LIGHT_M_PER_S)
    np.testing.assert_allclose(means[0], expected, atol=1e-12)
    assert nodes.frequencies_hz.mean() == pytest.approx(CHIRP.frequencies_hz.mean())
    far = np.exp(-4j * np.pi * 0.34 * CHIRP.frequencies_hz / SPEED_OF_LIGHT_M_PER_S)[None]
    _, weakened = averaged_frequencies(far, CHIRP, num_nodes, 0.3)
    turn = 2 * np.pi * 0.04 * 3.6e9 / num_nodes / SPEED_OF_LIGHT_M_PER_S
    # the mean over a run of samples is a sampled sinc: T / M samples miss its shape by their square
    np.testing.assert_allclose(np.abs(weakened), abs(np.sin(turn) / turn), rtol=0.02)


def test_a_chirp_of_few_samples_is_refused() -> None:
    with pytest.raises(RadarError, match="at least 4 samples, got 3"):
        averaged_frequencies(np.ones((1, 3)), Chirp(77e9, 3.6e9, 3), 4, 0.3)
