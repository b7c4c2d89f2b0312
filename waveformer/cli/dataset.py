"""`waveformer dataset`: what a dataset holds, whether it is whole, and its tidying up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from waveformer.cli.report import print_notes, print_result, progress

if TYPE_CHECKING:
    from waveformer.datagen.dataset_reader import Dataset

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="Look into a dataset, verify it, and tidy it up."
)
Store = Annotated[Path, typer.Argument(metavar="STORE", help="Folder of the dataset.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")]
_SHEET_SAMPLES = 24
_MAX_NOTES = 20


@app.command()
def info(store: Store, json_output: AsJson = False) -> None:
    """Show how many samples there are, of what, with which arrays."""
    from waveformer.datagen.dataset_card import card_of
    from waveformer.datagen.dataset_reader import open_dataset

    data = open_dataset(store)
    card = card_of(data)
    samples = card["samples"]
    lines = [
        (
            f"{store}: {samples['requested']} requested = {samples['committed']} committed + "
            f"{samples['quarantined']} quarantined + {samples['pending']} pending, {card['objects']} objects"
        ),
        *(
            f"  {name}: {tuple(array['shape'])} {array['dtype']}, {array['bytes_per_sample']:,} bytes a sample"
            for name, array in card["arrays"].items()
        ),
    ]
    print_result(card, "\n".join(lines), json_output)


@app.command()
def verify(store: Store, json_output: AsJson = False) -> None:
    """Read every committed byte and compare it with what was written; exit code 1 if anything differs."""
    from waveformer.datagen.dataset_audit import audit

    with progress("shards") as report:
        found = audit(store, report)
    print_notes(found.damaged[:_MAX_NOTES])
    if len(found.damaged) > _MAX_NOTES:
        print_notes([f"and {len(found.damaged) - _MAX_NOTES} more"])
    summary = {
        "requested": found.requested,
        "committed": found.committed,
        "quarantined": found.quarantined,
        "pending": found.pending,
        "damaged": list(found.damaged),
        "strays": [str(path) for path in found.strays],
    }
    state = f"{len(found.damaged)} damaged files" if found.damaged else "all intact"
    tail = f", {len(found.strays)} files without a record (waveformer dataset gc)" if found.strays else ""
    print_result(summary, f"{store}: {found.balance}; {state}{tail}", json_output)
    if found.damaged:
        raise typer.Exit(1)


@app.command()
def gc(
    store: Store,
    damaged: Annotated[
        bool, typer.Option("--damaged", help="Also take back damaged shards; the next run makes them again.")
    ] = False,
    quarantined: Annotated[
        bool,
        typer.Option(
            "--quarantined", help="Also take back shards with quarantined samples, to try them again."
        ),
    ] = False,
    json_output: AsJson = False,
) -> None:
    """Remove what killed runs left behind: temporary files, and shards that were never committed."""
    from waveformer.datagen.dataset_audit import damaged_shards, quarantined_shards, sweep, withdraw
    from waveformer.datagen.dataset_store import read_layout

    layout = read_layout(store)
    shards = set(damaged_shards(store, layout)) if damaged else set()
    if quarantined:
        shards |= set(quarantined_shards(store, layout))
    withdraw(store, sorted(shards))
    removed = sweep(store)
    summary = {"removed": len(removed), "withdrawn_shards": sorted(shards)}
    print_result(
        summary, f"{store}: {len(removed)} files removed, {len(shards)} shards taken back", json_output
    )


@app.command()
def show(
    store: Store,
    out: Annotated[Path, typer.Option(help="Picture to write.", metavar="SHEET.png")],
    first: Annotated[int, typer.Option(help="Begin with this committed sample.", min=0)] = 0,
    count: Annotated[int, typer.Option(help="Samples shown.", min=1, max=120)] = _SHEET_SAMPLES,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing picture.")] = False,
) -> None:
    """Draw a contact sheet: truth in grey, partials in red, chosen candidates in blue."""
    from waveformer.datagen.dataset_reader import open_dataset
    from waveformer.simulator.errors import StoreError

    data = open_dataset(store)
    indices = data.indices[first : first + count]
    if len(indices) == 0:
        raise StoreError(f"{store} has {len(data)} committed samples: none from {first} on")
    _draw(data, list(indices), out, force)
    typer.echo(f"{out}: {len(indices)} of {len(data)} samples")


@app.command()
def card(store: Store, json_output: AsJson = False) -> None:
    """Write the dataset's card (README.md, card.json) and a contact sheet (samples.png) into its folder."""
    from waveformer.datagen.dataset_reader import open_dataset

    print_result(write_card(open_dataset(store)), f"{store}: README.md, card.json, samples.png", json_output)


@app.command()
def migrate(store: Store) -> None:
    """Bring a dataset of an older version to the present one; an interrupted migration goes on."""
    from waveformer.datagen.dataset_migration import migrate_dataset

    rewritten = migrate_dataset(store)
    typer.echo(
        f"{store}: {rewritten} files rewritten" if rewritten else f"{store} has the present version already"
    )


def write_card(data: Dataset) -> dict[str, Any]:
    """Write card and contact sheet of a dataset into its folder; returns the card."""
    from waveformer.datagen.dataset_card import CARD_FILE, README_FILE, card_markdown, card_of
    from waveformer.simulator.storage import publish_file

    found = card_of(data)
    texts = {CARD_FILE: json.dumps(found, indent=1) + "\n", README_FILE: card_markdown(data.root.name, found)}
    for name, text in texts.items():
        with publish_file(data.root / name, overwrite=True) as temporary:
            temporary.write_text(text, encoding="utf-8")
    if len(data) and "truth_m" in data.arrays:
        _draw(data, list(data.indices[:_SHEET_SAMPLES]), data.root / "samples.png", True)
    return found


def _draw(data: Dataset, indices: list[int], out: Path, force: bool) -> None:
    from waveformer.eval.contact_sheet import contact_sheet
    from waveformer.simulator.storage import publish_file

    with publish_file(out, overwrite=force) as temporary:
        contact_sheet(data, indices, temporary)
