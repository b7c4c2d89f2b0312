"""`waveformer evaluate`: reconstruct all scans of a twin and score them, beside the paper's rows."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from waveformer.cli.report import print_result, progress


def evaluate(
    root: Annotated[Path, typer.Argument(help="Twin written by `waveformer twin`.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of scores, pictures and table. [ROOT-evaluation]", metavar="FOLDER"),
    ] = None,
    methods: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="backprojection (0.4 of the largest |S|), backprojection_0.3, backprojection_li, proposal, mmnorm, "
            "mmnorm_voxels, extruded, mirrored. May be repeated. [all]",
        ),
    ] = None,
    condition: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only these. May be repeated. [all]")
    ] = None,
    spacing: Annotated[float, typer.Option(help="Voxel edge, metres.")] = 0.003,
    pictures: Annotated[bool, typer.Option(help="Draw every scan.")] = True,
    seed: Annotated[int, typer.Option(help="Seed of antennas, background samples and completions.")] = 0,
    json_output: Annotated[bool, typer.Option("--json", help="Print the table as JSON.")] = False,
) -> None:
    """Reconstruct all scans of a twin by several methods and print the table of their scores.

    Scans that were evaluated before with the same settings are not done again.
    """
    from waveformer.eval.evaluate import evaluate_twin
    from waveformer.eval.methods import METHODS, require_methods
    from waveformer.eval.table_markdown import to_markdown
    from waveformer.model.proposal import ProposalSettings
    from waveformer.simulator.storage import publish_file

    names = require_methods(methods or list(METHODS))
    folder = out or root.with_name(root.name + "-evaluation")
    started = time.perf_counter()
    with progress("evaluating") as report:
        table, records = evaluate_twin(
            root, folder, names, conditions=condition or (), settings=ProposalSettings(spacing_m=spacing),
            seed=seed, pictures=pictures, progress=report,
        )  # fmt: skip
    markdown = to_markdown(table)
    for name, text in (("table.md", markdown), ("table.json", json.dumps(table.to_json(), indent=1))):
        with publish_file(folder / name, overwrite=True) as temporary:
            temporary.write_text(text, encoding="utf-8")
    failed = [f"{record['object_id']} ({record['condition']})" for record in records if record["reason"]]
    summary = {
        "out": str(folder),
        "scans": len(records),
        "without_surface": failed,
        "seconds": round(time.perf_counter() - started, 1),
        "median_proposal_s": sorted(record["seconds"] for record in records)[len(records) // 2],
        "table": table.to_json(),
    }
    lines = [markdown, f"{folder}: {len(records)} scans, table.md, table.json and a file and picture each"]
    if failed:
        lines.append(f"without a surface: {', '.join(failed)}")
    print_result(summary, "\n".join(lines), json_output)
