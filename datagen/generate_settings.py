"""What a generated dataset holds, and the ranges from which each of its samples draws."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from waveformer.datagen.partials import PartialSettings
from waveformer.simulator.permittivity import PERMITTIVITIES


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if not (all(math.isfinite(end) for end in pair) and pair[0] <= pair[1]):
        raise ValueError(f"must be [low, high] with low <= high, got {list(pair)}")
    return pair


def _not_negative(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] < 0:
        raise ValueError(f"must not be negative, got {list(pair)}")
    return pair


Span = Annotated[tuple[float, float], AfterValidator(_ascending)]
PositiveSpan = Annotated[tuple[float, float], AfterValidator(_ascending), AfterValidator(_not_negative)]


class _Group(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ApertureSettings(_Group):
    """A regular grid of positions in z = 0, centred at the origin, one antenna each.

    Attributes:
        num_x, num_y: positions along x and y.
        spacing_m: pitch; a coarser one aliases.
    """

    num_x: int = Field(default=76, ge=1, le=10_000)
    num_y: int = Field(default=101, ge=1, le=10_000)
    spacing_m: float = Field(default=0.004, gt=0.0, le=0.05)


class ChirpSettings(_Group):
    """The chirp, see `Chirp`; the default has MITO's range bins in few samples."""

    start_hz: float = Field(default=77.5001e9, gt=0.0)
    bandwidth_hz: float = Field(default=3.0009e9, gt=0.0)
    num_samples: int = Field(default=64, ge=2)


class PlacementSettings(_Group):
    """Where an object lies, and how large it is.

    Attributes:
        longest_side_m: of the bounding box. Objects of known size keep theirs, cut to this range; of others it is drawn
            evenly in its logarithm.
        size_jitter: factor on a known size.
        orientation: "resting", as it comes to rest when it is dropped; "any"; or "upright", turned about z only.
        support_z_m: height of the plane on which it rests; lower where a high object would come closer than
            `least_depth_m`.
        offset_m: of the box's centre from the aperture's, along x and y.
        least_depth_m: of its top below the aperture.
    """

    longest_side_m: PositiveSpan = (0.05, 0.35)
    size_jitter: PositiveSpan = (0.9, 1.1)
    orientation: Literal["resting", "any", "upright"] = "resting"
    support_z_m: Span = (-0.47, -0.43)
    offset_m: PositiveSpan = (0.0, 0.03)
    least_depth_m: float = Field(default=0.28, gt=0.0)

    @model_validator(mode="after")
    def _below(self) -> PlacementSettings:
        if self.support_z_m[1] >= 0 or self.longest_side_m[0] <= 0 or self.size_jitter[0] <= 0:
            raise ValueError("support_z_m must lie below the aperture at z = 0, sizes and factors above 0")
        return self


class MaterialSettings(_Group):
    """What objects are made of.

    Attributes:
        conductor_share: of the objects that are conductors whose echo is weakened by one factor.
        reflectivity: that factor.
        permittivity, loss_tangent: of the others, bodies so lossy or thick that their back does not show.
        roughness_m: rms height of the surface.
    """

    conductor_share: float = Field(default=0.5, ge=0.0, le=1.0)
    reflectivity: PositiveSpan = (0.15, 1.0)
    permittivity: PositiveSpan = (2.0, 7.0)
    loss_tangent: PositiveSpan = (0.0, 0.05)
    roughness_m: PositiveSpan = (0.0, 2e-4)


class OccluderSettings(_Group):
    """The sheet between radar and object.

    Attributes:
        sheet_share: of the samples that have one.
        materials: of which it may be.
        thickness_m: of it.
        clearance_m: between its lower face and the top of the object.
        tilt_deg: of its normal from z.
        echo: whether its own reflection is added.
    """

    sheet_share: float = Field(default=0.5, ge=0.0, le=1.0)
    materials: tuple[str, ...] = ("cardboard", "foam", "wood", "plastic")
    thickness_m: PositiveSpan = (0.0005, 0.004)
    clearance_m: PositiveSpan = (0.01, 0.05)
    tilt_deg: PositiveSpan = (0.0, 2.0)
    echo: bool = True

    @model_validator(mode="after")
    def _known(self) -> OccluderSettings:
        if unknown := [name for name in self.materials if name not in PERMITTIVITIES]:
            raise ValueError(f"unknown material {unknown[0]!r}; known: {', '.join(sorted(PERMITTIVITIES))}")
        if not self.materials or self.thickness_m[0] <= 0:
            raise ValueError("needs at least one material and a positive thickness_m")
        return self


class FrontEndSettings(_Group):
    """What the radar does to the signal.

    Attributes:
        mirror_snr_db: noise below the signal of a mirror at 0.4 m.
        row_depth_error_m: standard deviation of one depth error for each row of the raster.
        range_bias_m: known delay inside the radar, as round-trip path.
    """

    mirror_snr_db: Span = (30.0, 60.0)
    row_depth_error_m: PositiveSpan = (0.0, 3e-4)
    range_bias_m: Span = (0.0, 0.15)


class SignalSettings(_Group):
    """Raw signals H; leave the section out of a config for none."""

    chirp: ChirpSettings = ChirpSettings()
    mode: Literal["draft", "fast", "exact"] = "draft"
    material: MaterialSettings = MaterialSettings()
    occluder: OccluderSettings = OccluderSettings()
    front_end: FrontEndSettings = FrontEndSettings()


class GenerateSettings(_Group):
    """A dataset of samples; every object gives `views` of them.

    Attributes:
        views: poses of an object.
        truth_points: of the complete surface, in farthest-point order, so that any first part covers it.
        partial_variants: draws of Eq. 2-3 and noise for each view; 0 leaves partials out.
        aperture: the antennas.
        placement: pose and size.
        partial: ranges of partials.
        signal: raw signals; None leaves them out.
        shard_samples: samples made and committed together; None takes a size that suits the arrays.
        seed: of everything.
        time_limit_s, memory_limit_gib: of one sample, after which it is given up.
    """

    views: int = Field(default=2, ge=1, le=1000)
    truth_points: int = Field(default=16_384, ge=256, le=1_000_000)
    partial_variants: int = Field(default=1, ge=0, le=100)
    aperture: ApertureSettings = ApertureSettings()
    placement: PlacementSettings = PlacementSettings()
    partial: PartialSettings = PartialSettings()
    signal: SignalSettings | None = None
    shard_samples: int | None = Field(default=None, ge=1, le=4096)
    seed: int = Field(default=0, ge=0)
    time_limit_s: float = Field(default=180.0, gt=0.0)
    memory_limit_gib: float = Field(default=6.0, gt=0.5)

    @model_validator(mode="after")
    def _something(self) -> GenerateSettings:
        if self.partial_variants == 0 and self.signal is None:
            raise ValueError(
                "asks for neither partials nor signals: give partial_variants or a [signal] section"
            )
        return self
