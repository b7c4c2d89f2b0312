"""What `waveformer generate` can be told, by file and by flag."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from waveformer.config import Config
from waveformer.datagen.generate_settings import GenerateSettings


class ObjectsConfig(Config):
    """Where objects come from: a catalogue, a folder that is scanned first, or code.

    Attributes:
        catalog: Parquet file of `waveformer catalog scan`.
        meshes: folder of meshes, or of a table of them.
        source: layout of that folder.
        unit_m: metres per unit of its files; None = as the source says.
        procedural: number of objects made in code instead.
        sources, splits, categories: take only these; None takes all.
        limit: take so many objects.
    """

    catalog: str | None = None
    meshes: str | None = None
    source: str = "folder"
    unit_m: Annotated[float, Field(gt=0.0)] | None = None
    procedural: Annotated[int, Field(ge=1)] | None = None
    sources: tuple[str, ...] | None = None
    splits: tuple[str, ...] | None = None
    categories: tuple[str, ...] | None = None
    limit: Annotated[int, Field(ge=1)] | None = None

    @model_validator(mode="after")
    def _one_origin(self) -> ObjectsConfig:
        given = [name for name in ("catalog", "meshes", "procedural") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"needs one of catalog, meshes and procedural, got {' and '.join(given) or 'none'}: say where objects "
                "come from"
            )
        return self


class GenerateConfig(GenerateSettings):
    """All settings of a dataset, and where its objects come from.

    Attributes:
        objects: their origin.
        workers: processes of one thread each.
    """

    objects: ObjectsConfig
    workers: Annotated[int, Field(ge=1)] = 1

    def settings(self) -> GenerateSettings:
        """What determines the samples of given objects."""
        return GenerateSettings.model_validate(self.model_dump(exclude={"objects", "workers"}))

    def relative_to(self, folder: Path) -> GenerateConfig:
        """With paths that are relative to a folder."""
        moved = {
            name: str(folder / value)
            for name in ("catalog", "meshes")
            if (value := getattr(self.objects, name)) is not None
        }
        return self.model_copy(update={"objects": self.objects.model_copy(update=moved)})
