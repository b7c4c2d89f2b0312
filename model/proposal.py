"""Phase 1 of the paper: from a raw signal H to candidate surfaces of the hidden object, and mmNorm's choice.

focus     image S (Eq. 1) and normals N of a crop, S of a sparse background       `simulator.focus`
mask      voxels that reflect specularly, by Li's threshold over the whole volume  `threshold`
parts     6-connected components                                                    `components`
potential f of every component, from its normals (Eq. 5)                            `potential`
surfaces  level sets of f, every half wavelength (Eq. 6)                            `surfaces`
choice    the level whose simulated echo fits the measured one                      `selection`
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from waveformer.model.components import connected_components
from waveformer.model.confidence_default import DEFAULT_CONFIDENCE
from waveformer.model.confidence_features import ConfidenceFeatures, confidence_features
from waveformer.model.imaging_volume import (
    Volume,
    crop_grid,
    find_crop,
    imaging_volume,
    sample_background,
)
from waveformer.model.normals import has_normal
from waveformer.model.potential import integrate_breadth_first, integrate_least_squares
from waveformer.model.scan_warnings import scan_warnings
from waveformer.model.selection import Selection, SelectionSettings, select_levels
from waveformer.model.surfaces import (
    PotentialField,
    SurfaceStack,
    all_surface_points,
    levels,
    surface_points,
    voxel_points,
)
from waveformer.model.threshold import SpecularMask, specular_mask
from waveformer.model.uncertainty import UncertaintyTest, column_ratio
from waveformer.simulator.focusing import Focus, focus
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement


class ProposalSettings(BaseModel):
    """How surfaces are proposed.

    Attributes:
        spacing_m: edge of a voxel.
        field: "breadth_first" is the paper's integration, "least_squares" a weighted Poisson equation.
        selection: how a level is chosen.
        uncertainty: the paper's test of the chosen cloud.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    spacing_m: float = Field(default=3e-3, gt=0.0, le=0.01)
    field: Literal["breadth_first", "least_squares"] = "breadth_first"
    selection: SelectionSettings = SelectionSettings()
    uncertainty: UncertaintyTest = UncertaintyTest()


@dataclass(frozen=True, eq=False)
class Proposal:
    """Candidate surfaces of a scan.

    Attributes:
        focus: image and normals of the crop; None if nothing reflects.
        mask: voxels that reflect specularly; None with `focus`.
        fields: potential of every component, the largest first.
        levels_m: levels of every component, ascending, shape (L_c,) each.
        stacks: surface of every component at all its levels.
        selection: the chosen levels; None without components.
        reason: why there is no surface; "" otherwise.
        warnings: what the user should know about the scan.
        uncertain: whether the chosen cloud fails the paper's test; True without one.
    """

    focus: Focus | None
    mask: SpecularMask | None
    fields: tuple[PotentialField, ...] = ()
    levels_m: tuple[NDArray[np.float64], ...] = ()
    stacks: tuple[SurfaceStack, ...] = ()
    selection: Selection | None = None
    reason: str = ""
    warnings: tuple[str, ...] = ()
    uncertain: bool = True

    @property
    def chosen_m(self) -> tuple[float | None, ...]:
        """Chosen level of every component; None where none could be chosen."""
        indices = () if self.selection is None else self.selection.level_index
        return tuple(
            float(at[index]) if index >= 0 else None for at, index in zip(self.levels_m, indices, strict=True)
        )

    def surface_m(self) -> NDArray[np.float64]:
        """The chosen surface as sub-voxel points, shape (P, 3); empty if none was chosen."""
        return _together([surface_points(field, at).points_m for field, at in self._chosen_fields()])

    def voxels_m(self) -> NDArray[np.float64]:
        """The chosen surface as centres of voxels with |f - level| < their edge, shape (P, 3), as mmNorm gives it."""
        return _together([voxel_points(field, at) for field, at in self._chosen_fields()])

    def column_ratio(self) -> float:
        """The paper's ratio of the chosen cloud; NaN without one."""
        if self.focus is None:
            return float("nan")
        return column_ratio(self.voxels_m(), float(np.diff(self.focus.grid.x[:2])[0]))

    def features(self, measurement: Measurement) -> ConfidenceFeatures | None:
        """What a confidence in this proposal is computed from; None without a chosen surface."""
        if self.focus is None or self.mask is None or self.selection is None or self.selection.is_empty:
            return None
        assert self.focus.normals is not None, "a proposal is made with normals"
        return confidence_features(
            self.selection, self.stacks, measurement, self.focus.grid, self.focus.image, self.focus.normals,
            self.mask.mask, self.column_ratio(),
        )  # fmt: skip

    def confidence(self, measurement: Measurement) -> float:
        """Chance, 0 .. 1, that more than 60 % of the surface's points lie on the object, see `confidence_default`."""
        return DEFAULT_CONFIDENCE.score(self.features(measurement))

    def _chosen_fields(self) -> list[tuple[PotentialField, float]]:
        return [(f, at) for f, at in zip(self.fields, self.chosen_m, strict=False) if at is not None]


def propose_surfaces(
    measurement: Measurement,
    settings: ProposalSettings | None = None,
    *,
    crop: Volume | None = None,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None = None,
) -> Proposal:
    """Candidate surfaces of the object in a scan, and the one that fits the signal best.

    Args:
        measurement: h of shape (N, T); its known range bias is taken out.
        settings: None means the defaults.
        crop: box that holds the object and 3 cm around it; None looks for it in the volume that MITO images, which
            takes longer than all the rest.
        rng: draws the background's samples and the antennas of the choice.
        progress: of the imaging, called with (blocks done, blocks in all).

    Returns:
        The candidates; without any, the reason.

    Raises:
        RadarError: h holds non-finite samples, or the crop lies elsewhere.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    settings = settings or ProposalSettings()
    if not measurement.h.any():
        return Proposal(None, None, reason="the signal is zero: nothing was recorded")
    warnings = scan_warnings(measurement)
    volume = imaging_volume(measurement)
    if crop is None:
        crop = find_crop(measurement, volume, progress)
        if crop is None:
            return Proposal(None, None, reason="nothing in the imaged volume reflects", warnings=warnings)
    grid = crop_grid(crop, volume, settings.spacing_m)

    background = sample_background(measurement, volume, grid, rng)
    focused = focus(measurement, grid, progress=progress)  # Eq. 1 and mmNorm's normals
    assert focused.normals is not None, "asked for"
    mask = specular_mask(focused.image, grid, background)
    components = connected_components(mask.mask & has_normal(focused.normals), grid)
    if not components:
        reason = mask.reason or "no part of the image that reflects is as large as an object"
        return Proposal(focused, mask, reason=reason, warnings=warnings)
    fields = tuple(_field(focused, component, grid, settings) for component in components)  # Eq. 5
    wavelength_m = float(measurement.chirp.wavelengths_m[0])
    levels_m = tuple(levels(field, wavelength_m) for field in fields)
    stacks = tuple(  # Eq. 6
        all_surface_points(field, at) for field, at in zip(fields, levels_m, strict=True)
    )
    warnings = (*warnings, *filter(None, [mask.reason]))
    proposal = Proposal(focused, mask, fields, levels_m, stacks, warnings=warnings)
    return choose_surfaces(proposal, measurement, settings, rng=rng)


def choose_surfaces(
    proposal: Proposal, measurement: Measurement, settings: ProposalSettings, *, rng: np.random.Generator
) -> Proposal:
    """The same candidates with another choice among them.

    Args:
        proposal: with candidates.
        measurement: that they come from.
        settings: of the choice and of the test of the chosen cloud; the others are not looked at.
        rng: draws the antennas.

    Raises:
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    counts = [len(at) for at in proposal.levels_m]
    selection = select_levels(proposal.stacks, counts, measurement, settings.selection, rng=rng)
    earlier = "" if proposal.selection is None else proposal.selection.note
    warnings = tuple(warning for warning in proposal.warnings if warning != earlier)
    if selection.is_empty:
        chosen = replace(proposal, selection=selection, reason=selection.note, warnings=warnings)
    else:
        noted = (*warnings, *filter(None, [selection.note]))
        chosen = replace(proposal, selection=selection, reason="", warnings=noted)
    return replace(chosen, uncertain=settings.uncertainty.is_uncertain(chosen.column_ratio()))


def _field(
    focused: Focus, component: NDArray[np.int64], grid: Grid, settings: ProposalSettings
) -> PotentialField:
    normals = focused.normals
    assert normals is not None, "asked for"
    own = normals[tuple(component.T)].astype(np.float64)
    if settings.field == "breadth_first":
        return PotentialField(grid, component, integrate_breadth_first(normals, component, grid), own)
    weights = np.abs(focused.image)
    return PotentialField(grid, component, integrate_least_squares(normals, weights, component, grid), own)


def _together(clouds: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate(clouds) if clouds else np.empty((0, 3))
