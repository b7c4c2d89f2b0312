"""`waveformer simulate`: mesh in, raw signal out."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from waveformer import __version__
from waveformer.cli.report import print_notes, print_result, progress

if TYPE_CHECKING:
    from waveformer.cli.scan_config import SimulateConfig
    from waveformer.simulator.measurement import Measurement


def simulate(
    out: Annotated[Path, typer.Option(help="Scan to write, a Zarr v3 store.", metavar="SCAN.zarr")],
    meshes: Annotated[
        list[Path] | None, typer.Argument(metavar="MESH...", help="Mesh files (PLY, OBJ, STL, GLB, OFF).")
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
    radar: Annotated[str | None, typer.Option(help="Radar preset: mito, 77-81ghz, 24ghz. [mito]")] = None,
    aperture: Annotated[
        str | None,
        typer.Option(help="Aperture preset: small (18 x 18 cm), mito (30 x 40 cm), single. [small]"),
    ] = None,
    mode: Annotated[str | None, typer.Option(help="fast, or exact (slow reference). [fast]")] = None,
    tile_positions: Annotated[
        int | None, typer.Option(help="Most antenna positions in flight at once; bounds memory.")
    ] = None,
    threads: Annotated[int | None, typer.Option(help="Threads of the ray tracer. [all cores]")] = None,
    fix_winding: Annotated[
        bool | None, typer.Option("--fix-winding", help="Flip meshes that are turned inside out.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed, recorded in the scan. [0]")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing scan.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Simulate the raw radar signal of meshes and save it as a scan."""
    from waveformer.cli.scan_config import SimulateConfig
    from waveformer.config import load_config
    from waveformer.simulator.measurement import MEASUREMENT_FORMAT
    from waveformer.simulator.storage import check_writable

    overrides = {
        "meshes": [str(mesh) for mesh in meshes] if meshes else None,
        "unit": unit,
        "place_m": place,
        "rotate_deg": rotate,
        "radar": radar,
        "aperture": aperture,
        "mode": mode,
        "tile_positions": tile_positions,
        "threads": threads,
        "fix_winding": fix_winding,
        "seed": seed,
    }
    settings = load_config(config, SimulateConfig, overrides)
    check_writable(out, force, MEASUREMENT_FORMAT)
    # Paths of a file are relative to the file, those of the command line to the working directory.
    folder = config.parent if config is not None and not meshes else Path()
    started = time.perf_counter()
    measurement, problems = run_scan(settings, folder)
    measurement.save(out, overwrite=force)
    print_notes(problems)

    level_db, range_m = strongest_echo(measurement)
    num_positions, num_samples = measurement.h.shape
    seconds = time.perf_counter() - started
    echo = (
        "no echo at all: no surface faces the aperture"
        if level_db is None
        else f"strongest echo {level_db:.1f} dB (received / transmitted power) at {range_m:.3f} m"
    )
    print_result(
        {
            "out": str(out),
            "positions": num_positions,
            "samples": num_samples,
            "seconds": round(seconds, 3),
            "peak_db": level_db,
            "peak_range_m": range_m,
            "notes": problems,
        },
        f"{out}: {num_positions} positions x {num_samples} samples in {seconds:.1f} s; {echo}",
        json_output,
    )


def run_scan(config: SimulateConfig, folder: Path) -> tuple[Measurement, list[str]]:
    """Simulate what a configuration describes; progress goes to stderr.

    Args:
        config: the scan.
        folder: relative mesh paths start here.

    Returns:
        The scan, with its configuration and the origin of its meshes in the metadata; and remarks.
    """
    from waveformer.cli.scan_config import load_targets
    from waveformer.simulator.forward import simulate as simulate_scene
    from waveformer.simulator.radar import Aperture, Chirp
    from waveformer.simulator.runtime import activate

    chirp = Chirp(**config.radar.model_dump())
    aperture = Aperture.planar_grid(**config.aperture.model_dump())
    loaded = load_targets(config, folder)
    if config.threads is not None:
        activate(config.threads)
    with progress("simulating antenna positions") as report:
        measurement = simulate_scene(
            loaded.targets,
            chirp,
            aperture,
            mode=config.mode,
            tile_positions=config.tile_positions,
            seed=config.seed,
            progress=report,
        )
    origin: dict[str, Any] = {
        "meshes": loaded.records,
        "config": config.model_dump(mode="json"),
        "waveformer_version": __version__,
    }
    return dataclasses.replace(measurement, metadata={**measurement.metadata, **origin}), loaded.problems


def strongest_echo(measurement: Measurement) -> tuple[float, float] | tuple[None, None]:
    """Level in dB (received over transmitted power) and range in metres of the highest range-profile peak."""
    import numpy as np

    range_m, magnitude = measurement.range_profile()
    highest = magnitude.max(axis=0)
    peak = int(highest.argmax())
    if not highest[peak] > 0:
        return None, None
    return float(20 * np.log10(highest[peak])), float(range_m[peak])
