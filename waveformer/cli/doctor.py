"""`waveformer doctor`: does this machine have what the work needs?"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from waveformer.doctor import Row


def doctor(
    json_output: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Check that this machine has what the work needs.

    Python, system libraries, packages, disk and memory are tried out, and each problem comes with its
    remedy. Exit code 0 only if nothing failed; warnings are allowed.
    """
    from waveformer.doctor import as_json, is_healthy, run_checks

    rows = run_checks()
    if json_output:
        typer.echo(as_json(rows))
    elif sys.stdout.isatty():
        _print_table(rows)
    else:
        _print_lines(rows)
    if not is_healthy(rows):
        raise typer.Exit(1)


def _print_table(rows: list[Row]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    color = {"ok": "green", "warn": "yellow", "fail": "bold red"}
    table = Table("check", "status", "found")
    for row in rows:
        # Text, not markup: a path may hold square brackets.
        found = Text(row.found)
        if row.remedy:
            found.append(f"\nremedy: {row.remedy}", style="bold")
        table.add_row(row.name, Text(row.status, style=color.get(row.status, "")), found)
    Console().print(table)


def _print_lines(rows: list[Row]) -> None:
    for row in rows:
        typer.echo(f"{row.name:<10} {row.status:<5} {row.found}")
        if row.remedy:
            typer.echo(f"{'':<16} remedy: {row.remedy}")
