"""`waveformer propose`: a dataset of signals in, a dataset of their candidate surfaces out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from waveformer.cli.factory import check_request, run_and_report


def propose(
    store: Annotated[
        Path, typer.Argument(metavar="STORE", help="Dataset with signals (waveformer generate).")
    ],
    out: Annotated[
        Path, typer.Option(help="Folder of the new dataset; the same command goes on in it.", metavar="STORE")
    ],
    config: Annotated[
        Path | None, typer.Option(help="TOML file with settings; options given here go over it.")
    ] = None,
    candidates: Annotated[int | None, typer.Option(help="Surfaces kept of each signal. [64]")] = None,
    points: Annotated[int | None, typer.Option(help="Points of each surface. [2048]")] = None,
    spacing: Annotated[float | None, typer.Option(help="Voxel edge, metres. [0.003]")] = None,
    crop: Annotated[
        str | None,
        typer.Option(
            help="bounds (image the object's box and 3 to 4.5 cm around) or search for it. [bounds]"
        ),
    ] = None,
    workers: Annotated[int, typer.Option(help="Processes, each with one thread (Dask).", min=1)] = 1,
    scheduler: Annotated[str | None, typer.Option(help="Address of a running Dask scheduler.")] = None,
    shard_index: Annotated[int, typer.Option(help="For job arrays: this job's part, from 0.")] = 0,
    num_shards: Annotated[int, typer.Option(help="For job arrays: number of parts.")] = 1,
    seed: Annotated[
        int | None, typer.Option(help="Seed of drawn antennas and background samples. [0]")
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Find the candidate surfaces of every signal, with their losses and which of them is nearest to the truth."""
    from waveformer.config import load_config
    from waveformer.model.propose_run import prepare_proposals
    from waveformer.model.propose_settings import ProposeSettings

    check_request(out, shard_index, num_shards)
    overrides: dict[str, Any] = {
        "candidates": candidates,
        "points": points,
        "proposal.spacing_m": spacing,
        "crop": crop,
        "seed": seed,
    }
    layout = prepare_proposals(out, store, load_config(config, ProposeSettings, overrides))
    run_and_report(
        out,
        workers=workers,
        scheduler=scheduler,
        shard_index=shard_index,
        num_shards=num_shards,
        summary={"source": str(store), "samples": layout.num_samples},
        json_output=json_output,
    )
