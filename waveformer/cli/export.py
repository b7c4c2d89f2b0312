"""`waveformer export`: a dataset in formats that other programs read."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from waveformer.cli.report import print_notes, print_result, progress
from waveformer.simulator.errors import StoreError

if TYPE_CHECKING:
    from collections.abc import Callable

    from waveformer.datagen.export_choice import ExportChoice


class Format(StrEnum):
    """Formats of an export."""

    NPZ = "npz"
    HDF5 = "hdf5"
    WEBDATASET = "webdataset"
    DCA1000 = "dca1000"


def export(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="A dataset, finished or not.")],
    out: Annotated[Path, typer.Option(help="A new folder; for hdf5 a new file.")],
    format_: Annotated[
        Format,
        typer.Option(
            "--format",
            help="npz: a file a sample. hdf5: one file. webdataset: tar files. dca1000: signals as 16-bit recordings "
            "of TI radars.",
        ),
    ],
    arrays: Annotated[
        list[str] | None,
        typer.Option(help="Export this array, e.g. truth_m. May be repeated. [all; dca1000: h]"),
    ] = None,
    split: Annotated[
        list[str] | None, typer.Option(help="train or evaluation. May be repeated. [both]")
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Take the first so many samples. [all]")] = None,
    device: Annotated[
        str | None,
        typer.Option(
            help="dca1000: whose order the numbers get, xwr16xx, xwr18xx, xwr68xx (two lanes), xwr12xx or xwr14xx "
            "(four). [xwr18xx]"
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing export.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Write committed samples for programs that know nothing of waveformer. Lengths are metres, frequencies hertz.

    An export appears complete or not at all; interrupted, the same command goes on (hdf5: starts anew).
    """
    from waveformer.datagen.dataset_reader import open_dataset
    from waveformer.datagen.export_choice import SIGNAL, ExportChoice

    if format_ is not Format.DCA1000 and device is not None:
        raise StoreError(f"--device belongs to --format dca1000, not to {format_}")
    if format_ is Format.DCA1000 and arrays not in (None, [SIGNAL]):
        raise StoreError(f"--format dca1000 exports signals only: leave --arrays out, or give {SIGNAL}")
    data = open_dataset(store)
    choice = ExportChoice.choose(data, names=arrays, splits=split, limit=limit)
    try:
        with progress("samples") as report:
            _write(choice, out, format_, device, force, report)
    except KeyboardInterrupt as error:
        kept = "nothing was kept" if format_ is Format.HDF5 else "the same command goes on"
        raise KeyboardInterrupt(kept) from error
    if data.num_pending:
        print_notes([f"{data.num_pending} samples are not made yet and not exported"])
    if data.quarantined:
        print_notes([f"{len(data.quarantined)} samples are quarantined and not exported"])
    names = [SIGNAL] if format_ is Format.DCA1000 else list(choice.names)
    files = [out] if out.is_file() else [path for path in out.rglob("*") if path.is_file()]
    size = sum(path.stat().st_size for path in files)
    summary = {
        "out": str(out),
        "format": str(format_),
        "samples": len(choice),
        "arrays": names,
        "files": len(files),
        "bytes": size,
    }
    text = f"{out}: {len(choice)} samples ({', '.join(names)}), {size / 1e6:.1f} MB"
    print_result(summary, text, json_output)


def _write(
    choice: ExportChoice,
    out: Path,
    format_: Format,
    device: str | None,
    force: bool,
    report: Callable[[int, int], None],
) -> None:
    from waveformer.datagen.export_dca1000 import DEFAULT_DEVICE, export_dca1000
    from waveformer.datagen.export_hdf5 import export_hdf5
    from waveformer.datagen.export_npz import export_npz
    from waveformer.datagen.export_webdataset import export_webdataset

    if format_ is Format.DCA1000:
        export_dca1000(choice, out, overwrite=force, progress=report, device=device or DEFAULT_DEVICE)
        return
    writers = {Format.NPZ: export_npz, Format.HDF5: export_hdf5, Format.WEBDATASET: export_webdataset}
    writers[format_](choice, out, overwrite=force, progress=report)
