"""What `waveformer propose` makes of a dataset of signals."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from waveformer.model.proposal import ProposalSettings


class ProposeSettings(BaseModel):
    """Candidate surfaces of every signal.

    Attributes:
        candidates: surfaces kept of each sample, those with the least loss; a field seldom has more levels.
        points: of each surface at most; the first 256 are its farthest points.
        crop: "bounds" images the object's box and the air around it, "search" looks for what reflects.
        proposal: how surfaces are found.
        seed: of antennas and background samples.
        shard_samples: samples made and committed together.
        time_limit_s, memory_limit_gib: of one sample, after which it is given up.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    candidates: int = Field(default=64, ge=1, le=1000)
    points: int = Field(default=2048, ge=16, le=100_000)
    crop: Literal["bounds", "search"] = "bounds"
    proposal: ProposalSettings = ProposalSettings()
    seed: int = Field(default=0, ge=0)
    shard_samples: int = Field(default=16, ge=1, le=4096)
    time_limit_s: float = Field(default=120.0, gt=0.0)
    memory_limit_gib: float = Field(default=8.0, gt=0.5)
