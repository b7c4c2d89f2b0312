"""`waveformer simulate`: meshes or a scene file in, raw signal out."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from waveformer.cli.report import print_notes, print_result


def simulate(
    out: Annotated[Path, typer.Option(help="Scan to write, a Zarr v3 store.", metavar="SCAN.zarr")],
    meshes: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="MESH...",
            help="Mesh files (PLY, OBJ, STL, GLB, OFF), or one Mitsuba scene (XML) with radar_specular and "
            "radar_sheet BSDFs, which then describes objects, sheets and box.",
        ),
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="TOML file with the same settings; options given here go over it.")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Length unit of the mesh files: m, cm, mm or in. [m]")
    ] = None,
    place: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="Put the centre of the meshes' bounding box here, metres, e.g. 0 0 -0.4: z is up, and the "
            "presets' aperture lies in z = 0 and looks down. Default: meshes stay where they are.",
        ),
    ] = None,
    rotate: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="RX RY RZ", help="Turn about the fixed x, then y, then z axis, degrees. [0 0 0]"
        ),
    ] = None,
    material: Annotated[
        str | None,
        typer.Option(
            metavar="NAME[,KEY=VALUE...]",
            help="What the meshes are made of: pec, a named material or a permittivity, then thickness_m of a thin "
            "wall and roughness_m (rms), e.g. abs,thickness_m=0.003 or 2.6-0.02j. [pec]",
        ),
    ] = None,
    sheet: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MATERIAL,z_m=Z,thickness_m=D[,echo=true]",
            help="An infinite sheet whose upper face lies at height Z, metres, e.g. "
            "cardboard,z_m=-0.15,thickness_m=0.004; may be repeated.",
        ),
    ] = None,
    box: Annotated[
        str | None,
        typer.Option(
            metavar="MATERIAL[,KEY=VALUE...]",
            help="A closed box around the objects with margin_m of air (0.05) and walls of thickness_m (0.004), e.g. "
            "cardboard,margin_m=0.1; or between outer corners: "
            "'cardboard,min_m=-0.2 -0.2 -0.6,max_m=0.2 0.2 -0.2'.",
        ),
    ] = None,
    radar: Annotated[str | None, typer.Option(help="Radar preset: mito, 77-81ghz, 24ghz. [mito]")] = None,
    aperture: Annotated[
        str | None,
        typer.Option(
            help="Aperture preset: small (18 x 18 cm), mito (30 x 40 cm), single, mito_quarter_wave (22 x 55 cm, "
            "130,640 positions), mito_raster (30 x 40 cm, 44,110 positions). [small]"
        ),
    ] = None,
    receivers: Annotated[
        str | None,
        typer.Option(help="Receivers beside the transmitter: mito, mito_y (4). [one, at the transmitter]"),
    ] = None,
    antenna: Annotated[str | None, typer.Option(help="Antenna preset: iwr1443. [isotropic, 0 dBi]")] = None,
    polarization: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Direction of E at both antennas. [0 1 0]"),
    ] = None,
    front_end: Annotated[
        str | None,
        typer.Option(help="Front-end preset: ideal, iwr1443, mito_los, mito_nlos. [ideal]"),
    ] = None,
    mode: Annotated[
        str | None, typer.Option(help="fast, exact (slow reference) or draft (coarser). [fast]")
    ] = None,
    tile_positions: Annotated[
        int | None, typer.Option(help="Most antenna positions in flight at once; bounds memory.")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="Threads of the ray tracer. [all cores]")] = None,
    workers: Annotated[
        int | None,
        typer.Option(help="Processes of a streamed scan, each with one thread. [as many as threads]"),
    ] = None,
    stream: Annotated[
        bool,
        typer.Option(
            "--stream",
            help="Write the scan block by block as it is computed; always so above 16,384 antenna pairs.",
        ),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with an interrupted streamed scan of the same settings.")
    ] = False,
    fix_winding: Annotated[
        bool | None, typer.Option("--fix-winding", help="Flip meshes that are turned inside out.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Seed of all that the front end draws, recorded in the scan. [0]")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing scan.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Simulate the raw radar signal of meshes or of a Mitsuba scene and save it as a scan."""
    from waveformer.cli.scan_config import SimulateConfig
    from waveformer.cli.scan_run import (
        prepare_scan,
        run_in_memory,
        run_streamed,
        strongest_echo,
        strongest_stored_echo,
    )
    from waveformer.config import load_config
    from waveformer.simulator.forward_model import BLOCK_POSITIONS
    from waveformer.simulator.measurement import MEASUREMENT_FORMAT
    from waveformer.simulator.storage import check_writable

    overrides = {
        "meshes": [str(mesh) for mesh in meshes] if meshes else None,
        "unit": unit,
        "place_m": place,
        "rotate_deg": rotate,
        "material": material,
        "sheets": sheet or None,
        "box": box,
        "radar": radar,
        "aperture": aperture,
        "receivers": receivers,
        "antenna": antenna,
        "polarization": polarization,
        "front_end": front_end,
        "mode": mode,
        "tile_positions": tile_positions,
        "threads": threads,
        "workers": workers,
        "fix_winding": fix_winding,
        "seed": seed,
    }
    settings = load_config(config, SimulateConfig, overrides)
    check_writable(out, force, MEASUREMENT_FORMAT)
    # Paths of a file are relative to the file, those of the command line to the working directory.
    folder = config.parent if config is not None and not meshes else Path()
    started = time.perf_counter()
    scan = prepare_scan(settings, folder)
    streamed = stream or resume or len(scan.aperture) > BLOCK_POSITIONS
    if streamed:
        processes = settings.workers or settings.threads
        run_streamed(scan, out, workers=processes, overwrite=force, resume=resume)
        echo, metadata = strongest_stored_echo(out)
    else:
        measurement = run_in_memory(scan, settings.threads)
        measurement.save(out, overwrite=force)
        echo, metadata = strongest_echo(measurement), dict(measurement.metadata)
    print_notes(scan.problems)
    summary = {
        "out": str(out),
        "positions": len(scan.aperture),
        "samples": scan.chirp.num_samples,
        "seconds": round(time.perf_counter() - started, 3),
        "streamed": streamed,
        "peak_db": echo.level_db,
        "peak_range_m": echo.range_m,
        "targets": [
            {name: target[name] for name in ("name", "material", "bounds_m")}
            for target in metadata["targets"]
        ],
        **metadata["surroundings"],
        "front_end": metadata["front_end"],
        "seed": metadata["seed"],
        "notes": scan.problems,
    }
    print_result(summary, _describe(summary), json_output)


def _describe(summary: Mapping[str, Any]) -> str:
    echo = (
        "no echo at all: no surface faces the aperture"
        if summary["peak_db"] is None
        else f"strongest echo {summary['peak_db']:.1f} dB (received / transmitted power) at "
        f"{summary['peak_range_m']:.3f} m"
    )
    size = f"{summary['positions']} positions x {summary['samples']} samples"
    return f"{summary['out']}: {size} in {summary['seconds']:.1f} s; {echo}"
