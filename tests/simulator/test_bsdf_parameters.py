"""Parameters of the BSDF plugins: what they mean and which are refused."""

from __future__ import annotations

from typing import Any

import pytest

from waveformer.simulator.bsdf_parameters import parse_bsdf
from waveformer.simulator.errors import RadarError
from waveformer.simulator.materials import Material


@pytest.mark.parametrize(
    ("values", "material"),
    [
        ({"material": "pec", "roughness": 1e-4}, Material.pec(1e-4)),
        ({"material": "wood"}, Material.named("wood")),
        ({"material": "wood", "thickness": 0.003}, Material.named("wood", 0.003)),
        ({"permittivity": 2}, Material.dielectric(2.0)),
        (
            {"permittivity": 2.7, "loss": 0.1, "thickness": 1e-3, "roughness": 2e-5},
            Material.dielectric(2.7 - 0.1j, 1e-3, 2e-5),
        ),
    ],
)
def test_the_material_is_the_one_written_in_python(values: dict[str, Any], material: Material) -> None:
    assert parse_bsdf("radar_specular", values).material == material


def test_a_sheet_is_a_slab_without_echo_unless_asked() -> None:
    sheet = parse_bsdf("radar_sheet", {"permittivity": 1.5, "loss": 0.05, "thickness": 4e-3})
    assert sheet.permittivity == 1.5 - 0.05j
    assert not sheet.echo
    assert parse_bsdf("radar_sheet", {"material": "cardboard", "thickness": 4e-3, "echo": True}).echo


@pytest.mark.parametrize(
    ("plugin", "values", "message"),
    [
        ("radar_specular", {"material": "pec", "colour": 1}, "no parameter 'colour'; known: .*roughness"),
        ("radar_specular", {"material": "pec", "echo": True}, "no parameter 'echo'"),
        (
            "radar_sheet",
            {"material": "wood", "thickness": 1e-3, "roughness": 0.0},
            "no parameter 'roughness'",
        ),
        ("radar_specular", {}, "needs either material"),
        ("radar_specular", {"material": "pec", "permittivity": 2.0}, "needs either material"),
        ("radar_specular", {"material": "unobtainium"}, "unknown material 'unobtainium'; known: .*wood"),
        ("radar_specular", {"material": 3}, "material must be a name"),
        ("radar_specular", {"material": "wood", "loss": 0.1}, "loss belongs to permittivity"),
        ("radar_specular", {"permittivity": "2.7"}, "permittivity must be a finite number, got '2.7'"),
        ("radar_specular", {"permittivity": 0.5}, "eps' >= 1"),
        ("radar_specular", {"permittivity": 2.0, "loss": -0.1}, "eps'' >= 0"),
        ("radar_specular", {"permittivity": float("nan")}, "permittivity must be a finite number"),
        ("radar_specular", {"material": "pec", "thickness": 1e-3}, "no thickness"),
        ("radar_specular", {"material": "wood", "thickness": -1e-3}, "thickness_m must lie in"),
        ("radar_specular", {"material": "pec", "roughness": True}, "roughness must be a finite number"),
        ("radar_specular", {"material": "pec", "lobe_width": 0.0}, "lobe_width must lie in"),
        ("radar_specular", {"material": "pec", "frequency": 79.0}, "frequency must lie in"),
        ("radar_sheet", {"material": "wood"}, "needs thickness"),
        ("radar_sheet", {"material": "pec", "thickness": 1e-3}, "lets nothing through; use radar_specular"),
        ("radar_sheet", {"material": "wood", "thickness": 1e-3, "echo": 1}, "echo must be true or false"),
    ],
)
def test_refusals(plugin: str, values: dict[str, Any], message: str) -> None:
    with pytest.raises(RadarError, match=message) as refusal:
        parse_bsdf(plugin, values)
    assert "\n" not in str(refusal.value)
