"""What `generate` and `propose` share: running the factory, and telling what became of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from waveformer.cli.dataset import write_card
from waveformer.cli.report import print_notes, print_result, progress

if TYPE_CHECKING:
    from waveformer.datagen.factory_run import RunState

MAX_NOTES = 10


def check_request(out: Path, shard_index: int, num_shards: int) -> None:
    """Raise a WaveformerError for what cannot work, before anything takes time."""
    from waveformer.datagen.factory_run import Partition
    from waveformer.simulator.errors import StoreError

    Partition(shard_index, num_shards)
    if out.exists() and not out.is_dir():
        raise StoreError(f"{out} is a file: name the folder of a dataset")


def run_and_report(
    out: Path,
    *,
    workers: int,
    scheduler: str | None,
    shard_index: int,
    num_shards: int,
    summary: dict[str, Any],
    json_output: bool,
) -> None:
    """Make all samples of a prepared dataset, write its card, and print the balance.

    Raises:
        typer.Exit: code 1 if a sample was quarantined or is missing.
        WaveformerError, KeyboardInterrupt: as `run_factory`; what was committed stays.
    """
    from waveformer.datagen.dataset_reader import open_dataset
    from waveformer.datagen.factory_run import Partition, RunState, run_factory

    partition = Partition(shard_index, num_shards)
    state = RunState()
    try:
        with progress("samples") as report:

            def show(now: RunState) -> None:
                nonlocal state
                state = now
                report(now.done, now.requested)

            state = run_factory(out, workers=workers, scheduler=scheduler, partition=partition, progress=show)
    except KeyboardInterrupt as error:
        raise KeyboardInterrupt(f"{state.balance}; the same command goes on") from error
    data = open_dataset(out)
    given_up = data.quarantined
    notes = [f"sample {index} quarantined: {reason}" for index, reason in given_up.items()]
    print_notes(notes[:MAX_NOTES])
    if len(notes) > MAX_NOTES:
        print_notes([f"and {len(notes) - MAX_NOTES} more: waveformer dataset info --json lists each"])
    if num_shards == 1:
        write_card(data)
    found = {
        **summary,
        "out": str(out),
        "requested": state.requested,
        "committed": state.committed,
        "quarantined": state.quarantined,
        "pending": state.pending,
        "written": state.written,
        "samples_per_hour": round(state.samples_per_hour),
    }
    text = f"{out}: {state.balance}; {state.written} made now"
    text += f", {state.samples_per_hour:.0f} an hour" if state.written else ""
    print_result(found, text, json_output)
    if state.pending or state.quarantined:
        raise typer.Exit(1)
