"""How commands talk: progress on stderr, results on stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import typer

_LINE_EVERY = 0.25  # of the work, where there is no terminal to draw a bar on


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """Yield a function (done, total) that shows a bar on a terminal and a few plain lines elsewhere."""
    if not sys.stderr.isatty():
        yield _line_reporter(label)
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bars:
        bar = bars.add_task(label, total=None)
        yield lambda done, total: bars.update(bar, completed=done, total=total)


def print_result(summary: Mapping[str, Any], text: str, as_json: bool) -> None:
    """Print the summary as one JSON object, or the text for people."""
    typer.echo(json.dumps(summary) if as_json else text)


def print_notes(notes: Sequence[str]) -> None:
    """Print remarks that do not stop the work, one line each, on stderr."""
    for note in notes:
        typer.echo(f"note: {note}", err=True)


def _line_reporter(label: str) -> Callable[[int, int], None]:
    announced = 0.0

    def report(done: int, total: int) -> None:
        nonlocal announced
        if total and done / total >= announced + _LINE_EVERY:
            announced = done / total // _LINE_EVERY * _LINE_EVERY
            typer.echo(f"{label}: {done} of {total}", err=True)

    return report
