"""``waveformer validate``: the simulator against theory, with the reason for every tolerance."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from waveformer.simulator.validation import CheckResult


def validate(
    quick: Annotated[
        bool, typer.Option("--quick", help="A subset, about half a minute on two cores.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for validation.png, validation.json and validation.md."),
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
    mode: Annotated[
        Literal["both", "fast", "exact"], typer.Option("--mode", help="Simulator modes to test.")
    ] = "both",
    seed: Annotated[int, typer.Option("--seed", help="Seed of random rotations and positions.")] = 0,
) -> None:
    """Compare simulated echoes with closed forms and exact solutions (levels in dB, phases in degrees).

    Exit code 0 if every check is within its tolerance, 1 otherwise.
    """
    import json

    from waveformer.simulator.validation import MODES, run_validation
    from waveformer.simulator.validation_report import markdown_table, plot_validation, summary, to_json

    modes = MODES if mode == "both" else (mode,)
    results = run_validation(
        quick=quick, modes=modes, seed=seed, progress=lambda line: typer.echo(line, err=True)
    )
    report = json.dumps(
        to_json(results, quick=quick, modes=list(modes), seed=seed), indent=1, allow_nan=False
    )
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "validation.json").write_text(report + "\n", encoding="utf-8")
        (out / "validation.md").write_text(markdown_table(results), encoding="utf-8")
    if json_output:
        typer.echo(report)
    else:
        (_print_table if sys.stdout.isatty() else _print_lines)(results)
        typer.echo(summary(results))
    if out is not None:
        plot_validation(results, out / "validation.png")  # last: a failing plot must not hide the table
        typer.echo(f"written to {out}", err=True)
    if not all(result.passed for result in results):
        raise typer.Exit(1)


def _print_table(results: Sequence[CheckResult]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from waveformer.simulator.validation_report import HEADINGS, table_rows

    table = Table(*HEADINGS, show_lines=True)
    for result, row in zip(results, table_rows(results), strict=True):
        style = "" if result.passed else "bold red"
        table.add_row(*(Text(cell, style=style) for cell in row))  # Text: cells are not markup
    Console().print(table)


def _print_lines(results: Sequence[CheckResult]) -> None:
    for r in results:
        verdict = "pass" if r.passed else "FAIL"
        measured = f"{r.measured:.3g} of {r.tolerance:g} {r.unit}"
        typer.echo(f"{verdict}  {r.mode or '-':<5}  {r.name}: {r.quantity}: {measured}")
        typer.echo(f"{'':<13}against {r.reference}; tolerance: {r.tolerance_source}")
