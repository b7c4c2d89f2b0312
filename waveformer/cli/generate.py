"""`waveformer generate`: meshes in, a dataset of partials, signals and truth out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from waveformer.cli.factory import MAX_NOTES, check_request, run_and_report
from waveformer.cli.report import print_notes, progress

if TYPE_CHECKING:
    from waveformer.cli.generate_config import GenerateConfig
    from waveformer.datagen.catalog import Catalog


def generate(
    out: Annotated[
        Path, typer.Option(help="Folder of the dataset; the same command goes on in it.", metavar="STORE")
    ],
    config: Annotated[
        Path | None, typer.Argument(metavar="[CONFIG]", help="TOML file; options given here go over it.")
    ] = None,
    catalog: Annotated[
        str | None, typer.Option(help="Catalogue of the objects (waveformer catalog scan).")
    ] = None,
    meshes: Annotated[str | None, typer.Option(help="Or a folder of meshes, which is scanned first.")] = None,
    source: Annotated[
        str | None, typer.Option(help="Layout of that folder, see waveformer catalog scan. [folder]")
    ] = None,
    procedural: Annotated[int | None, typer.Option(help="Or so many objects made in code.")] = None,
    split: Annotated[
        list[str] | None, typer.Option(help="train or evaluation. May be repeated. [both]")
    ] = None,
    limit: Annotated[int | None, typer.Option(help="Take so many objects. [all]")] = None,
    views: Annotated[int | None, typer.Option(help="Poses of every object. [2]")] = None,
    signals: Annotated[
        bool | None,
        typer.Option("--signals/--partials-only", help="Also simulate the raw signal H. [the file's, or no]"),
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes, each with one thread (Dask). [1]")] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a running Dask scheduler, e.g. tcp://host:8786.")
    ] = None,
    shard_index: Annotated[
        int, typer.Option(help="For job arrays: this job's part of the work, from 0.")
    ] = 0,
    num_shards: Annotated[int, typer.Option(help="For job arrays: number of parts.")] = 1,
    seed: Annotated[int | None, typer.Option(help="Seed of everything. [0]")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Make a dataset: truth clouds, the paper's geometric partials (Eq. 2-3) and raw signals H of many objects.

    Nothing half-made ever counts. Objects that cannot be used are kept out with their reason and stop nothing.
    """
    from waveformer.cli.generate_config import GenerateConfig
    from waveformer.config import load_config
    from waveformer.datagen.generate_run import prepare_dataset

    check_request(out, shard_index, num_shards)
    origin = {"catalog": catalog, "meshes": meshes, "procedural": procedural}
    overrides: dict[str, Any] = {
        **{f"objects.{name}": value for name, value in origin.items()},
        "objects.source": source,
        "objects.splits": split or None,
        "objects.limit": limit,
        "views": views,
        "signal": {} if signals else None,
        "workers": workers,
        "seed": seed,
    }
    settings = load_config(config, GenerateConfig, overrides)
    if config is not None and not any(origin.values()):
        settings = settings.relative_to(config.parent)
    if signals is False:
        settings = settings.model_copy(update={"signal": None})
    chosen = _objects(settings, out)
    layout = prepare_dataset(out, chosen, settings.settings())
    run_and_report(
        out,
        workers=settings.workers,
        scheduler=scheduler,
        shard_index=shard_index,
        num_shards=num_shards,
        summary={"objects": len(chosen.entries), "samples": layout.num_samples},
        json_output=json_output,
    )


def _objects(settings: GenerateConfig, out: Path) -> Catalog:
    """The objects wanted; a folder is scanned once, and its catalogue kept beside the dataset."""
    from waveformer.datagen.catalog import Catalog
    from waveformer.datagen.catalog_scan import scan_catalog
    from waveformer.datagen.procedural_meshes import write_procedural_meshes
    from waveformer.simulator.errors import StoreError

    objects = settings.objects
    if objects.catalog is not None:
        found = Catalog.read(objects.catalog)
    else:
        root, kept = Path(objects.meshes or ""), out.with_name(f"{out.name}.catalog.parquet")
        unit_m = objects.unit_m
        if objects.procedural is not None:
            root, unit_m = out.with_name(f"{out.name}.meshes"), 1.0
            write_procedural_meshes(root, objects.procedural, settings.seed)
        if kept.exists():
            found = Catalog.read(kept)
            if found.root.resolve() != root.resolve():
                raise StoreError(
                    f"{kept} is the catalogue of {found.root}: remove it, or choose another --out"
                )
        else:
            with progress("meshes") as report:
                found = scan_catalog(
                    root, objects.source, workers=settings.workers, unit_m=unit_m,
                    journal=kept.with_suffix(".unfinished"), progress=report,
                )  # fmt: skip
            found.write(kept)
            kept.with_suffix(".unfinished").unlink(missing_ok=True)
    refused = [entry for entry in found.entries if entry.reason]
    print_notes([f"{entry.object_id} left out: {entry.reason}" for entry in refused[:MAX_NOTES]])
    if len(refused) > MAX_NOTES:
        print_notes([f"and {len(refused) - MAX_NOTES} more: see waveformer catalog show"])
    return found.select(
        sources=objects.sources, splits=objects.splits, categories=objects.categories, limit=objects.limit
    )
