import numpy as np
import pytest
from pydantic import ValidationError

from waveformer.datagen.generate_draws import (
    SampleSeed,
    draw_front_end,
    draw_material,
    draw_placement,
    draw_sheet,
)
from waveformer.datagen.generate_settings import (
    FrontEndSettings,
    GenerateSettings,
    MaterialSettings,
    OccluderSettings,
    PlacementSettings,
)
from waveformer.simulator import primitives

BOX = primitives.box(0.5, 0.8, 1.0).vertices


@pytest.mark.parametrize("orientation", ["resting", "any", "upright"])
def test_objects_rest_below_the_aperture_in_the_size_asked_for(rng, orientation):
    settings = PlacementSettings(orientation=orientation)
    sides = []
    for _ in range(50):
        placement = draw_placement(BOX, False, settings, rng)
        points = placement.points(BOX)
        low, high = points.min(axis=0), points.max(axis=0)
        assert low[2] == pytest.approx(placement.support_z_m) and high[2] <= -0.28 + 1e-9
        assert np.abs(0.5 * (low + high)[:2]).max() <= 0.03 + 1e-9
        sides.append(placement.scale * 1.0)
        np.testing.assert_allclose(placement.pose[:3, :3] @ placement.pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert 0.05 <= min(sides) < 0.08 and 0.2 < max(sides) <= 0.35


def test_a_known_size_is_kept_within_the_jitter(rng):
    ball = primitives.sphere(0.05, 0.02).vertices
    scales = [draw_placement(ball, True, PlacementSettings(), rng).scale for _ in range(100)]
    assert 0.9 <= min(scales) < 0.93 and 1.07 < max(scales) <= 1.1
    huge = draw_placement(20 * ball, True, PlacementSettings(), rng)
    assert 2.0 * huge.scale == pytest.approx(0.35, rel=1e-2)


def test_normals_turn_with_the_object(rng):
    mesh = primitives.sphere(0.05, 0.02)
    placement = draw_placement(mesh.vertices, True, PlacementSettings(), rng)
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    center = placement.points(np.zeros((1, 3)))
    turned = placement.points(mesh.vertices) - center
    np.testing.assert_allclose(
        placement.normals(normals), turned / np.linalg.norm(turned, axis=1, keepdims=True), atol=1e-9
    )


def test_materials_are_of_both_kinds_and_in_range(rng):
    drawn = [draw_material(MaterialSettings(), rng) for _ in range(300)]
    conductors = [(material, factor) for material, factor in drawn if material.is_conductor]
    assert 110 < len(conductors) < 190
    assert all(0.15 <= factor <= 1.0 for _, factor in conductors)
    assert all(factor == 1.0 for material, factor in drawn if not material.is_conductor)
    real = [material.permittivity.at(79e9).real for material, _ in drawn if not material.is_conductor]
    assert 2.0 <= min(real) < 2.5 and 6.5 < max(real) <= 7.0
    assert all(material.permittivity.at(79e9).imag <= 0 for material, _ in drawn if not material.is_conductor)


def test_a_sheet_hangs_clear_of_the_object(rng):
    sheets = [draw_sheet(OccluderSettings(), -0.33, rng) for _ in range(200)]
    some = [sheet for sheet in sheets if sheet is not None]
    assert 70 < len(some) < 130
    for sheet in some:
        lower_face_m = sheet.point_m[2] - sheet.thickness_m
        assert -0.32 - 1e-9 <= lower_face_m <= -0.28 + 1e-9
        assert sheet.normal[2] >= np.cos(np.deg2rad(2.0)) - 1e-12
    assert {sheet.permittivity for sheet in some} == set(OccluderSettings().materials)


def test_front_ends_are_in_range(rng):
    drawn = [draw_front_end(FrontEndSettings(), rng) for _ in range(100)]
    assert 30.0 <= min(f.mirror_snr_db for f in drawn) < 33.0
    assert max(f.row_depth_error_m for f in drawn) <= 3e-4
    assert max(f.range_bias_m for f in drawn) > 0.13


def test_random_numbers_belong_to_object_view_and_purpose():
    def first(*arguments, purpose="pose"):
        return SampleSeed(*arguments).generator(purpose).random()

    assert first(0, "a", 1) == first(0, "a", 1)
    others = {first(1, "a", 1), first(0, "b", 1), first(0, "a", 2), first(0, "a", 1, purpose="noise")}
    assert len(others | {first(0, "a", 1)}) == 5


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"placement": {"longest_side_m": [0.3, 0.1]}}, "low <= high"),
        ({"placement": {"longest_side_m": [0.0, 0.1]}}, "sizes and factors above 0"),
        ({"partial_variants": 0}, "neither partials nor signals"),
        ({"signal": {"occluder": {"materials": ["kryptonite"]}}}, "unknown material 'kryptonite'"),
        ({"signal": {"front_end": {"mirror_snr_db": [float("nan"), 1.0]}}}, "low <= high|finite"),
        ({"veiws": 3}, "Extra inputs"),
        ({"seed": -1}, "greater than or equal to 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(values, message):
    with pytest.raises(ValidationError, match=message):
        GenerateSettings.model_validate(values)
