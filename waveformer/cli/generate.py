"""`waveformer generate`: meshes in, a dataset of partials, signals and truth out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from waveformer.cli.report import print_notes, print_result, progress

if TYPE_CHECKING:
    from collections.abc import Callable

    from waveformer.cli.generate_config import GenerateConfig
    from waveformer.datagen.catalog import Catalog
    from waveformer.datagen.factory_run import RunState

_MAX_NOTES = 10


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
    from waveformer.datagen.dataset_reader import open_dataset
    from waveformer.datagen.factory_run import Partition, run_factory
    from waveformer.datagen.generate_run import prepare_dataset

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
    with _interruptible(out), _shown() as show:
        state = run_factory(
            out,
            workers=settings.workers,
            scheduler=scheduler,
            partition=Partition(shard_index, num_shards),
            progress=show,
        )
    given_up = open_dataset(out).quarantined if state.quarantined else {}
    notes = [f"sample {index} quarantined: {reason}" for index, reason in given_up.items()]
    print_notes(
        notes[:_MAX_NOTES] + ([f"and {len(notes) - _MAX_NOTES} more"] if len(notes) > _MAX_NOTES else [])
    )
    summary = {
        "out": str(out),
        "objects": len(chosen.entries),
        "samples": layout.num_samples,
        "requested": state.requested,
        "committed": state.committed,
        "quarantined": state.quarantined,
        "pending": state.pending,
        "written": state.written,
        "samples_per_hour": round(state.samples_per_hour),
    }
    text = f"{out}: {state.balance}; {state.written} made now, {state.samples_per_hour:.0f} an hour"
    print_result(summary, text, json_output)
    if state.pending:
        raise typer.Exit(1)


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
    print_notes([f"{entry.object_id} left out: {entry.reason}" for entry in refused[:_MAX_NOTES]])
    if len(refused) > _MAX_NOTES:
        print_notes([f"and {len(refused) - _MAX_NOTES} more: see waveformer catalog show"])
    return found.select(
        sources=objects.sources, splits=objects.splits, categories=objects.categories, limit=objects.limit
    )


@contextmanager
def _shown() -> Iterator[Callable[[RunState], None]]:
    """A function that shows the state of a run."""
    with progress("samples") as report:
        yield lambda state: report(state.done, state.requested)


@contextmanager
def _interruptible(out: Path) -> Iterator[None]:
    """Say after Ctrl-C what is kept."""
    try:
        yield
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(f"what was committed to {out} is kept: the same command goes on") from error
