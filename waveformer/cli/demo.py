"""`waveformer demo`: from nothing to pictures, with every step of a real use."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from waveformer.cli.report import print_notes, print_result

if TYPE_CHECKING:
    from waveformer.simulator.image import Image
    from waveformer.simulator.measurement import Measurement
    from waveformer.simulator.mesh import SurfaceMesh

_RANGE_M = 0.4
_SPACING_M = 0.0025
_NUM_SAMPLES = 256
_TOLERANCE_DEG = 5.0
_DARK_DB = -20.0
# Turned so that neither a flat side nor an axis lies parallel to the aperture.
_ROTATE_DEG = {"mug": (75.0, 0.0, 35.0), "hammer": (8.0, 5.0, 25.0)}


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the results.", metavar="DIR")],
    object_name: Annotated[
        Literal["mug", "hammer"], typer.Option("--object", help="What lies 0.4 m below the radar.")
    ] = "mug",
    seed: Annotated[int, typer.Option(help="Recorded in the scan.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace the results of an earlier demo.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Build an object, simulate its radar signal, form the image, and draw everything."""
    from waveformer.cli.image import form_image, image_grid
    from waveformer.cli.overlay import recorded_meshes
    from waveformer.cli.simulate import run_scan
    from waveformer.cli.view import write_view
    from waveformer.eval.figures import image_figure, range_profile_figure
    from waveformer.eval.scene import scene_layers
    from waveformer.simulator.storage import publish_file

    started = time.perf_counter()
    paths = result_paths(out, object_name)
    check_results_writable(paths, force)
    with publish_file(paths["mesh"], overwrite=force) as temporary:
        _build(object_name).export(temporary)
    measurement, notes = run_scan(_settings(paths["mesh"], object_name, seed), Path())
    measurement.save(paths["scan"], overwrite=force)
    image = form_image(measurement, image_grid(measurement, _SPACING_M), seed)
    image.save(paths["image"], overwrite=force)

    meshes, _ = recorded_meshes(measurement.metadata)
    with publish_file(paths["range profiles"], overwrite=force) as temporary:
        range_profile_figure(measurement, temporary)
    with publish_file(paths["projections"], overwrite=force) as temporary:
        image_figure(image, temporary, meshes=meshes, aperture=measurement.aperture)
    layers = scene_layers(meshes=meshes, aperture=measurement.aperture, image=image)
    for name in ("picture", "scene"):
        notes += write_view(layers, paths[name], force)
    print_notes(notes)
    summary = {
        "object": object_name,
        "seconds": round(time.perf_counter() - started, 3),
        **measure(meshes[0], measurement, image),
        "paths": {name: str(path) for name, path in paths.items()},
        "notes": notes,
    }
    print_result(summary, describe(summary), json_output)


def result_paths(folder: Path, object_name: str) -> dict[str, Path]:
    """What the demo writes."""
    return {
        "mesh": folder / f"{object_name}.ply",
        "scan": folder / "scan.zarr",
        "image": folder / "image.zarr",
        "range profiles": folder / "range_profiles.png",
        "projections": folder / "projections.png",
        "picture": folder / "scene.png",
        "scene": folder / "scene.html",
    }


def check_results_writable(paths: Mapping[str, Path], overwrite: bool) -> None:
    """Raise StoreError before the work if one of the results could not be written after it."""
    from waveformer.simulator.image import IMAGE_FORMAT
    from waveformer.simulator.measurement import MEASUREMENT_FORMAT
    from waveformer.simulator.storage import check_file_writable, check_writable

    formats = {"scan": MEASUREMENT_FORMAT, "image": IMAGE_FORMAT}
    for name, path in paths.items():
        if name in formats:
            check_writable(path, overwrite, formats[name])
        else:
            check_file_writable(path, overwrite)


def measure(mesh: SurfaceMesh, measurement: Measurement, image: Image) -> dict[str, Any]:
    """The numbers that the explanation rests on."""
    from waveformer.cli.simulate import strongest_echo
    from waveformer.eval.specular import bright_fraction, specular_fraction

    level_db, range_m = strongest_echo(measurement)
    return {
        "positions": len(measurement.aperture),
        "samples": measurement.chirp.num_samples,
        "wavelength_m": float(measurement.chirp.wavelengths_m[0]),
        "range_resolution_m": measurement.chirp.range_bin_m,
        "peak_db": level_db,
        "peak_range_m": range_m,
        "image_peak_m": image.peak_position_m.tolist(),
        "tolerance_deg": _TOLERANCE_DEG,
        "specular_area_fraction": specular_fraction(mesh, measurement.aperture, _TOLERANCE_DEG),
        "bright_level_db": _DARK_DB,
        "bright_area_fraction": bright_fraction(mesh, image, _DARK_DB),
    }


def describe(summary: Mapping[str, Any]) -> str:
    """One paragraph on what is seen and why, then where it is."""
    place = ", ".join(f"{100 * value:.1f}" for value in summary["image_peak_m"])
    specular, bright = 100 * summary["specular_area_fraction"], 100 * summary["bright_area_fraction"]
    text = (
        f"A {summary['object']} lies {100 * _RANGE_M:.0f} cm below {summary['positions']} antenna positions. "
        f"Its strongest echo returns {summary['peak_db']:.1f} dB of the transmitted power from "
        f"{100 * summary['peak_range_m']:.1f} cm; the image peaks at ({place}) cm and is blurred in range by "
        f"the resolution of the chirp, {100 * summary['range_resolution_m']:.1f} cm. Of the surface, "
        f"{bright:.0f} % is brighter than {summary['bright_level_db']:g} dB of that peak. The rest is dark, "
        f"because at {1000 * summary['wavelength_m']:.1f} mm wavelength a smooth surface is a mirror: it "
        "shines only where its normal points back at an antenna, which is so within "
        f"{summary['tolerance_deg']:g} degrees for {specular:.1f} % of its area. "
        f"Completing the dark part is what waveformer is for. ({summary['seconds']:.0f} s)"
    )
    return "\n".join([text, *(f"  {name}: {path}" for name, path in summary["paths"].items())])


def _build(object_name: str) -> Any:
    from waveformer.simulator import primitives

    return primitives.mug() if object_name == "mug" else primitives.hammer()


def _settings(mesh: Path, object_name: str, seed: int) -> Any:
    from waveformer.cli.scan_config import ChirpConfig, SimulateConfig
    from waveformer.simulator.presets import CHIRP_PRESETS

    return SimulateConfig(
        meshes=(str(mesh),),
        place_m=(0.0, 0.0, -_RANGE_M),
        rotate_deg=_ROTATE_DEG[object_name],
        # The band of MITO's radar; half its samples reach 6 m, far enough, in half the time.
        radar=ChirpConfig(**{**CHIRP_PRESETS["mito"], "num_samples": _NUM_SAMPLES}),
        seed=seed,
    )
