"""`waveformer twin`: what MITO's radar would have recorded of any objects, with the truth beside it."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from waveformer.cli.report import print_notes, print_result, progress

if TYPE_CHECKING:
    from waveformer.datagen.twin_run import TwinProgress


def twin(
    out: Annotated[
        Path, typer.Option(help="Folder of the twin; the same command goes on in it.", metavar="ROOT")
    ],
    meshes: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="MESHES...",
            help="Folders of meshes, mesh files, or tables (CSV with object_id, file and set); in metres.",
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="TOML file with the same settings; options given here go over it.")
    ] = None,
    condition: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="clean (or los); m40, m30: noise 40 or 30 dB below a mirror at 0.4 m; rows: 0.3 mm rms depth error per "
            "row, 50 dB; sheet: |Gamma| 0.1 at z = -0.26 m, 46 dB; box (or nlos): |Gamma| 0.05, 0.2 mm rows, 40 dB. "
            "May be repeated. [clean]",
        ),
    ] = None,
    mesh_set: Annotated[
        str | None, typer.Option("--set", help="Take only these rows of a table, e.g. ycb. [all]")
    ] = None,
    limit: Annotated[int | None, typer.Option(help="Take only the first objects. [all]")] = None,
    mode: Annotated[
        str | None,
        typer.Option(help="exact (a ray for every pair, minutes an object), or fast (seconds). [exact]"),
    ] = None,
    tessellation: Annotated[
        int | None,
        typer.Option(help="How often meshes are divided irregularly before they are summed. [1]"),
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes, each with one thread. [one a core]")] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of reflectivities, noise, row errors and tessellation. [0]")
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Simulate MITO's set-up: objects at rest 0.45 m below 76 x 101 positions at 4 mm, one scan per condition.

    Each scan is ROOT/CONDITION/OBJECT/scan.zarr, with truth.ply (metres, radar frame) and truth.json beside it.
    """
    from waveformer.cli.twin_config import TwinConfig
    from waveformer.config import load_config
    from waveformer.datagen.twin_conditions import resolve_conditions
    from waveformer.datagen.twin_objects import find_objects
    from waveformer.datagen.twin_run import TwinProgress, run_twin

    overrides = {
        "meshes": [str(mesh) for mesh in meshes] if meshes else None,
        "mesh_set": mesh_set,
        "limit": limit,
        "conditions": condition or None,
        "mode": mode,
        "tessellation": tessellation,
        "workers": workers,
        "seed": seed,
    }
    settings = load_config(config, TwinConfig, overrides)
    # Paths of a file are relative to the file, those of the command line to the working directory.
    folder = config.parent if config is not None and not meshes else Path()
    conditions = resolve_conditions(settings.conditions)
    objects = find_objects([folder / source for source in settings.meshes], settings.mesh_set, settings.limit)
    started = time.perf_counter()
    state = TwinProgress()
    try:
        with progress("scans") as report:

            def show(now: TwinProgress) -> None:
                nonlocal state
                state = now
                report(now.done, now.total)

            state = run_twin(
                out, objects, conditions, settings.build(), workers=settings.workers, progress=show
            )
    except KeyboardInterrupt as error:
        kept = f"{state.kept + state.written} of {state.total} scans are kept: the same command goes on"
        raise KeyboardInterrupt(kept) from error
    summary = {
        "out": str(out),
        "objects": len(objects),
        "conditions": [item.name for item in conditions],
        "scans": state.kept + state.written,
        "written": state.written,
        "kept": state.kept,
        "failures": [dataclasses.asdict(failure) for failure in state.failures],
        "seconds": round(time.perf_counter() - started, 3),
    }
    print_notes([f"{item.condition}/{item.object_id} not made: {item.reason}" for item in state.failures])
    print_result(summary, _describe(summary), json_output)
    if state.failures:
        raise typer.Exit(1)


def _describe(summary: Mapping[str, Any]) -> str:
    asked = f"{summary['objects']} objects x {', '.join(summary['conditions'])}"
    made = (
        f"{summary['written']} scans made, {summary['kept']} there before, {len(summary['failures'])} failed"
    )
    return f"{summary['out']}: {asked}: {made}, in {summary['seconds']:.1f} s"
