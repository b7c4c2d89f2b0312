"""Mitsuba's own chi-square test of the samplers against their densities."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from waveformer.simulator.bsdf import register_bsdfs

CONDUCTOR = {"type": "radar_specular", "material": "pec", "lobe_width": 12.0}
ROUGH = CONDUCTOR | {"roughness": 5e-4}
WOOD = {"type": "radar_specular", "material": "wood", "roughness": 2e-4, "correlation_length": 1e-3}
SHELL = {"type": "radar_specular", "permittivity": 2.8, "loss": 0.03, "thickness": 1.5e-3}
SHEET = {"type": "radar_sheet", "material": "cardboard", "thickness": 4e-3, "echo": True}

# A correct sampler fails one test in a thousand; the samples do not depend on the run, so none flickers.
SIGNIFICANCE = 1e-3


def accepts(description: dict[str, Any], angle_deg: float, sample_count: int, cells: int) -> bool:
    import mitsuba as mi
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    angle = np.radians(angle_deg)
    ctx = mi.BSDFContext()
    # what goes straight through a sheet has no density
    ctx.type_mask = +mi.BSDFFlags.GlossyReflection
    sample, density = BSDFAdapter(
        description["type"], description, wi=[float(np.sin(angle)), 0.0, float(np.cos(angle))], ctx=ctx
    )
    test = ChiSquareTest(
        SphericalDomain(), sample, density, sample_dim=3, sample_count=sample_count, res=cells, ires=32
    )
    return bool(test.run(SIGNIFICANCE, quiet=True))


@pytest.fixture(autouse=True)
def plugins(mitsuba_variant: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    # a failed test writes its histogram into the working directory
    monkeypatch.chdir(tmp_path)
    register_bsdfs()


@pytest.mark.parametrize(
    ("description", "angle_deg"),
    [(CONDUCTOR, 0.0), (ROUGH, 60.0), (WOOD, 80.0), (SHELL, 30.0), (SHEET, 120.0)],
    ids=["conductor", "rough", "wood", "shell", "sheet-from-below"],
)
def test_the_sampler_follows_its_density(description: dict[str, Any], angle_deg: float) -> None:
    assert accepts(description, angle_deg, 200_000, 151)


def test_the_chi_square_test_notices_a_density_that_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    from waveformer.simulator.bsdf_lobe import MirrorLobe

    density = MirrorLobe.pdf
    monkeypatch.setattr(MirrorLobe, "pdf", lambda lobe, wi, wo: density(lobe, wi, wo) * (1.0 + 0.1 * wo.x))
    assert not accepts(ROUGH, 60.0, 200_000, 151)


@pytest.mark.slow
@pytest.mark.parametrize("angle_deg", [0.0, 15.0, 45.0, 70.0, 85.0, 150.0])
@pytest.mark.parametrize(
    "description",
    [CONDUCTOR, ROUGH, WOOD, SHELL, SHEET],
    ids=["conductor", "rough", "wood", "shell", "sheet"],
)
def test_at_many_angles_with_many_samples(description: dict[str, Any], angle_deg: float) -> None:
    assert accepts(description, angle_deg, 1_000_000, 301)
