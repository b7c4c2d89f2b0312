"""Validation of the Mitsuba side: an ordinary incoherent render gives the mean power of the coherent sum."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from waveformer.simulator import primitives
from waveformer.simulator.materials import Material
from waveformer.simulator.radar import Aperture
from waveformer.simulator.target import Target
from waveformer.simulator.validation_curved import sphere_edge_m
from waveformer.simulator.validation_result import MITO_BAND, CheckResult, Trial, placed

_MATERIALS = {"conductor": Material.pec(), "abs": Material.named("abs")}


def incoherent_spheres(trial: Trial) -> Iterator[CheckResult]:
    """Spheres rendered with the material as a BSDF, against the mean of their coherent echo over the band."""
    if trial.quick:
        return
    from waveformer.simulator.incoherent import mean_echo_power

    antennas = Aperture(np.zeros((1, 3)))
    errors = {}
    for radius in (0.02, 0.05, 0.10):
        mesh, pose = primitives.sphere(radius, sphere_edge_m(radius)), placed((0, 0, -0.4 - radius))
        for name, material in _MATERIALS.items():
            target = Target(mesh, material, pose)
            coherent = (np.abs(trial.simulate(target, MITO_BAND, antennas)) ** 2).mean()
            incoherent = mean_echo_power(target, (0.0, 0.0, 0.0), MITO_BAND.center_hz, seed=trial.seed)
            errors[f"{name} {100 * radius:g} cm"] = abs(10 * np.log10(incoherent / coherent))
    yield CheckResult(
        f"spheres at 0.4 m: {', '.join(errors)}", "worst error of an incoherent render's mean echo power",
        max(errors.values()), 0.5, "dB", "mean over the band of the coherent sum",
        "a sphere has one highlight, so both must agree; the lobe of 5 deg spreads it by 0.01 dB", trial.mode,
        detail=errors,
    )  # fmt: skip
