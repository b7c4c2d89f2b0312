"""What `simulate` and `simulate_to_store` share: the signal that a noise level refers to."""

from __future__ import annotations

import numpy as np
import pytest

from waveformer.simulator import (
    Antenna,
    Aperture,
    Box,
    Chirp,
    FrontEnd,
    Material,
    Sheet,
    Target,
    forward_model,
    primitives,
    simulate,
)
from waveformer.simulator.forward_model import ForwardModel
from waveformer.simulator.front_end_noise import signal_power

pytestmark = pytest.mark.usefixtures("mitsuba_variant")

CHIRP = Chirp(77.5001e9, 3.0009e9, 32)
APERTURE = Aperture.planar_grid(12, 12, 0.008)


def ball():
    mesh = primitives.sphere(0.02, 0.003)
    mesh.apply_translation([0.02, 0.0, -0.3])
    return mesh


def test_a_large_scan_refers_to_an_even_choice_of_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    model = ForwardModel.prepare(ball(), CHIRP, APERTURE, front_end=FrontEnd(snr_db=20.0))
    assert model.reference_power() is None  # one block holds all rows
    monkeypatch.setattr(forward_model, "BLOCK_POSITIONS", 64)
    monkeypatch.setattr(forward_model, "_REFERENCE_POSITIONS", 40)
    found = model.reference_power()
    powers = signal_power(model.echo(APERTURE))
    # 40 of 144 rows: the standard error of their median is 1.25 / sqrt(40) of the spread
    assert found == pytest.approx(np.median(powers), abs=3 * 1.25 / np.sqrt(40) * powers.std())


def test_the_noise_of_a_scan_has_the_level_asked_for() -> None:
    ideal = simulate(ball(), CHIRP, APERTURE).h
    noise = simulate(ball(), CHIRP, APERTURE, front_end=FrontEnd(snr_db=20.0), seed=3).h - ideal
    per_bin = np.mean(np.abs(np.fft.ifft(noise, axis=1)) ** 2)
    level_db = 10 * np.log10(np.median(signal_power(ideal)) / per_bin)
    # 144 x 32 exponential powers: 0.06 dB standard deviation; three of them
    assert level_db == pytest.approx(20.0, abs=0.2)


@pytest.mark.parametrize("mode", ["fast", "exact"])
@pytest.mark.parametrize("around", ["open", "sheet", "box"])
def test_an_isotropic_gain_counts_twice_whatever_is_there(mode: str, around: str) -> None:
    level, few = Antenna.isotropic(10.0), Aperture.planar_grid(4, 4, 0.008)
    settings = {
        "open": {},
        "sheet": {"sheets": [Sheet((0, 0, -0.15), (0.1, 0, 1), 0.004, 2.6, echo=True)]},
        "box": {"box": Box((-0.05, -0.06, -0.36), (0.06, 0.05, -0.24), 0.004, "cardboard")},
    }[around]
    for material in (Material.dielectric(2.6 - 0.3j), Material.pec(3e-4)):
        target = Target(ball(), material=material)
        with_gain, without = (
            simulate(target, CHIRP, few, antenna=antenna, mode=mode, **settings).h
            for antenna in (level, None)
        )
        # 10 dB of power for each antenna; float32
        assert np.abs(with_gain - 10.0 * without).max() < 1e-5 * np.abs(with_gain).max()
