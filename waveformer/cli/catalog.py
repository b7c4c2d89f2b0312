"""`waveformer catalog`: what a mesh collection holds, which of it can be used, and why the rest cannot."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from waveformer.cli.report import print_notes, print_result, progress
from waveformer.simulator.errors import StoreError

if TYPE_CHECKING:
    from waveformer.datagen.catalog import Catalog
    from waveformer.datagen.catalog_items import UpAxis

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Look through a collection of meshes, and show what was found.",
)
_UNITS_M = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
_MAX_NOTES = 20


@app.command()
def scan(
    root: Annotated[Path, typer.Argument(metavar="ROOT", help="Folder of the meshes.")],
    out: Annotated[Path, typer.Option(help="The catalogue, a Parquet file.")],
    source: Annotated[
        str,
        typer.Option(
            help="Layout of the folder: omniobject3d, toys4k, objaverse, thingiverse, ycb, folder (any), or table "
            "(INDEX.csv with object_id, file and more)."
        ),
    ] = "folder",
    unit: Annotated[
        str | None,
        typer.Option(
            help="Length unit of the files: m, cm, mm, in, or metres as a number. [the source's, or unknown: only "
            "shapes count]"
        ),
    ] = None,
    up_axis: Annotated[str | None, typer.Option(help="x, y or z. [the source's; folder: z]")] = None,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="CATALOG",
            help="Refuse objects of the same shape as one in this catalogue. May be repeated.",
        ),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes that load meshes. [one a core]")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing catalogue.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Load every mesh of a folder once and write down what it is, or why it cannot be used.

    Nothing a file holds stops the scan. Ctrl-C does; the same command then goes on where it was.
    """
    from waveformer.datagen.catalog import Catalog
    from waveformer.datagen.catalog_scan import scan_catalog
    from waveformer.datagen.twin_workers import default_workers
    from waveformer.simulator.storage import check_file_writable

    check_file_writable(out, overwrite=force)
    journal = out.with_name(f".{out.name}.unfinished")
    unit_m, axis = _parse_unit(unit), _parse_axis(up_axis)
    others = [Catalog.read(path) for path in held_out or ()]
    try:
        with progress("meshes") as report:
            catalog = scan_catalog(
                root,
                source,
                workers=workers or default_workers(),
                unit_m=unit_m,
                up_axis=axis,
                held_out=others,
                journal=journal,
                progress=report,
            )
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt("what was loaded is kept: the same command goes on") from error
    catalog.write(out, overwrite=force)
    journal.unlink(missing_ok=True)
    _report(catalog, out, json_output)


@app.command()
def show(
    path: Annotated[Path, typer.Argument(metavar="CATALOG", help="A catalogue.")],
    json_output: Annotated[
        bool, typer.Option("--json", help="Print every object as one JSON object a line.")
    ] = False,
) -> None:
    """Show what a catalogue holds: how many objects, of what, under which licences, and what cannot be used."""
    import json

    from waveformer.datagen.catalog import Catalog

    catalog = Catalog.read(path)
    if not json_output:
        _report(catalog, path, as_json=False)
        return
    for entry in catalog.entries:
        record = dataclasses.asdict(entry)
        record["longest_side_m"] = None if math.isnan(entry.longest_side_m) else entry.longest_side_m
        typer.echo(json.dumps(record))


def _report(catalog: Catalog, path: Path, as_json: bool) -> None:
    refused = [entry for entry in catalog.entries if entry.reason]
    usable = [entry for entry in catalog.entries if not entry.reason]
    summary: dict[str, Any] = {
        "catalog": str(path),
        "root": str(catalog.root),
        "objects": len(catalog.entries),
        "usable": len(usable),
        "unusable": len(refused),
        "splits": dict(Counter(entry.split for entry in usable)),
        "sources": dict(Counter(entry.source for entry in usable)),
        "categories": len({entry.category for entry in usable if entry.category}),
        "licences": dict(Counter(entry.licence or "unknown" for entry in usable)),
        "watertight": sum(entry.watertight for entry in usable),
        "unit_unknown": sum(entry.unit_m is None for entry in usable),
        "repaired_or_odd": sum(bool(entry.problems) for entry in usable),
    }
    notes = [f"{entry.object_id} cannot be used: {entry.reason}" for entry in refused[:_MAX_NOTES]]
    if len(refused) > _MAX_NOTES:
        notes.append(
            f"and {len(refused) - _MAX_NOTES} more: waveformer catalog show --json lists each with its reason"
        )
    print_notes(notes)
    print_result(summary, _describe(summary), as_json)


def _describe(summary: dict[str, Any]) -> str:
    splits = ", ".join(f"{count} {name}" for name, count in sorted(summary["splits"].items(), reverse=True))
    counts = f"{summary['usable']} usable ({splits or 'none'}), {summary['unusable']} not"
    kinds = f"{summary['categories']} categories, {summary['watertight']} watertight"
    odd = f"{summary['repaired_or_odd']} repaired or odd, {summary['unit_unknown']} of unknown size"
    lines = [
        f"{summary['catalog']}: {summary['objects']} objects of {summary['root']}: {counts}",
        f"  {kinds}, {odd}",
    ]
    for what in ("sources", "licences"):
        most = Counter(summary[what]).most_common(8)
        shown = ", ".join(f"{name} {count}" for name, count in most)
        more = f", and {len(summary[what]) - len(most)} more" if len(summary[what]) > len(most) else ""
        lines.append(f"  {what}: {shown or 'none'}{more}")
    return "\n".join(lines)


def _parse_unit(text: str | None) -> float | None:
    if text is None or text in _UNITS_M:
        return None if text is None else _UNITS_M[text]
    try:
        unit_m = float(text)
    except ValueError:
        unit_m = math.nan
    if not (math.isfinite(unit_m) and unit_m > 0):
        raise StoreError(f"unknown unit {text!r}: give m, cm, mm, in, or metres as a number such as 0.001")
    return unit_m


def _parse_axis(text: str | None) -> UpAxis | None:
    from waveformer.datagen.catalog_items import UP_AXES

    axis = next((axis for axis in UP_AXES if axis == text), None)
    if text is not None and axis is None:
        raise StoreError(f"unknown up axis {text!r}: give x, y or z")
    return axis
