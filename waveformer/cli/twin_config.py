"""What `waveformer twin` can be told, by file and by flag."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from waveformer.cli.scan_config import ChirpConfig
from waveformer.config import Config

if TYPE_CHECKING:
    from waveformer.datagen.twin_settings import TwinSettings


class TwinApertureConfig(Config):
    """A regular grid in z = 0, centred at the origin.

    Attributes:
        num_x, num_y: positions along x and y.
        spacing_m: pitch, at most 4 mm.
    """

    num_x: Annotated[int, Field(ge=1)] = 76
    num_y: Annotated[int, Field(ge=1)] = 101
    spacing_m: Annotated[float, Field(gt=0.0)] = 0.004


class TwinConfig(Config):
    """A twin of MITO's set-up.

    Attributes:
        meshes: folders, mesh files or tables (CSV), in metres.
        mesh_set: the rows of a table to take, by its column set; None takes all.
        limit: take the first objects only.
        conditions: names of conditions.
        radar: start_hz, bandwidth_hz and num_samples.
        aperture: antenna positions.
        support_z_m: height of the plane on which objects rest.
        mode: "exact" or "fast".
        tessellation: how often meshes are divided irregularly before they are summed.
        workers: processes of one thread each; None = one a core.
        seed: of reflectivities, noise, row errors and tessellation.
    """

    meshes: Annotated[tuple[str, ...], Field(min_length=1)]
    mesh_set: str | None = None
    limit: Annotated[int, Field(ge=1)] | None = None
    conditions: tuple[str, ...] = ("clean",)
    radar: ChirpConfig = ChirpConfig(start_hz=77.5001e9, bandwidth_hz=3.0009e9, num_samples=64)
    aperture: TwinApertureConfig = TwinApertureConfig()
    support_z_m: Annotated[float, Field(lt=0.0)] = -0.45
    mode: Literal["exact", "fast"] = "exact"
    tessellation: Annotated[int, Field(ge=0)] = 1
    workers: Annotated[int, Field(ge=1)] | None = None
    seed: Annotated[int, Field(ge=0)] = 0

    def build(self) -> TwinSettings:
        """What all scans have in common; raises RadarError if it makes no sense."""
        from waveformer.datagen.twin_settings import TwinSettings
        from waveformer.simulator.radar import Chirp

        return TwinSettings(
            chirp=Chirp(**self.radar.model_dump()),
            **self.aperture.model_dump(),
            support_z_m=self.support_z_m,
            mode=self.mode,
            tessellation=self.tessellation,
            seed=self.seed,
        )
