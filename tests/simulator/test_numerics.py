"""The named numerical settings."""

import pytest
from pydantic import ValidationError

from waveformer.simulator.errors import RadarError
from waveformer.simulator.numerics import DRAFT, EXACT, FAST, Numerics, resolve_numerics


def test_modes_have_names_and_own_settings_pass_through() -> None:
    assert resolve_numerics("fast") is FAST
    assert resolve_numerics("exact") is EXACT
    assert resolve_numerics("draft") is DRAFT
    own = Numerics(spacing_wavelengths=0.2)
    assert resolve_numerics(own) is own


def test_exact_mode_shares_no_shortcut_with_fast_mode() -> None:
    assert EXACT.direct and not FAST.direct
    assert EXACT.spacing_wavelengths < FAST.spacing_wavelengths


def test_pieces_grow_with_the_object_and_no_further() -> None:
    wavelength_m, least = 0.0038, 0.0038 / 3
    assert FAST.spacing_m(10.0, wavelength_m) == pytest.approx(least)
    assert DRAFT.spacing_m(0.01, wavelength_m) == pytest.approx(least)
    assert least < DRAFT.spacing_m(0.07, wavelength_m) < 0.5 * wavelength_m
    assert DRAFT.spacing_m(10.0, wavelength_m) == pytest.approx(0.5 * wavelength_m)
    coarse = DRAFT.model_copy(update={"spacing_wavelengths": 0.7})
    assert coarse.spacing_m(10.0, wavelength_m) == pytest.approx(0.7 * wavelength_m)


def test_an_unknown_mode_names_the_known_ones() -> None:
    with pytest.raises(RadarError, match="unknown mode 'quick'; known: fast, exact, draft"):
        resolve_numerics("quick")


@pytest.mark.parametrize("settings", [{"spacing": 0.3}, {"spacing_wavelengths": 1.0}, {"tolerance": 0.0}])
def test_unknown_keys_and_senseless_values_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        Numerics(**settings)  # type: ignore[arg-type]


def test_settings_are_frozen() -> None:
    with pytest.raises(ValidationError):
        FAST.direct = True  # type: ignore[misc]
