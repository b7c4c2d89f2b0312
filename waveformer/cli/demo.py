"""`waveformer demo`: from nothing to pictures, with every step of a real use."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from waveformer.cli.report import print_notes, print_result

if TYPE_CHECKING:
    from waveformer.simulator.grid import Grid
    from waveformer.simulator.image import Image
    from waveformer.simulator.measurement import Measurement
    from waveformer.simulator.mesh import SurfaceMesh
    from waveformer.simulator.occluders import Box

_RANGE_M = 0.4
_SPACING_M = 0.003
_NUM_SAMPLES = 256
# 14 x 14 cm. At this pitch the grating lobes of the hammer's head lie outside the box.
_APERTURE: dict[str, Any] = {"num_x": 60, "num_y": 60, "spacing_m": 0.0024}
_TOLERANCE_DEG = 5.0
_DARK_DB = -20.0
# Turned so that neither a flat side nor an axis lies parallel to the aperture.
_ROTATE_DEG = {"mug": (75.0, 0.0, 35.0), "hammer": (8.0, 5.0, 25.0)}
# The lid echoes more strongly than the object, so it keeps three range bins (5 cm) from it, the floor two.
_BOX_LOW_M = {"mug": (-0.11, -0.11, -0.55), "hammer": (-0.16, -0.12, -0.55)}
_BOX_HIGH_M = {"mug": (0.11, 0.11, -0.20), "hammer": (0.16, 0.12, -0.20)}


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the results.", metavar="DIR")],
    object_name: Annotated[
        Literal["mug", "hammer"],
        typer.Option("--object", help="What lies in the box, 0.4 m below the radar."),
    ] = "mug",
    seed: Annotated[int, typer.Option(help="Recorded in the scan.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace the results of an earlier demo.")] = False,
    json_output: Annotated[bool, typer.Option("--json", help="Print the summary as JSON.")] = False,
) -> None:
    """Put an object into a cardboard box, simulate its radar signal, form the image, and draw everything."""
    from waveformer.cli.image import form_image
    from waveformer.cli.overlay import recorded_box, recorded_meshes
    from waveformer.cli.scan_run import prepare_scan, run_in_memory
    from waveformer.cli.view import write_view
    from waveformer.eval.figures import image_figure, range_profile_figure
    from waveformer.eval.scene import scene_layers
    from waveformer.simulator.storage import publish_file

    started = time.perf_counter()
    paths = result_paths(out, object_name)
    check_results_writable(paths, force)
    with publish_file(paths["mesh"], overwrite=force) as temporary:
        _build(object_name).export(temporary)
    scan = prepare_scan(_settings(paths["mesh"], object_name, seed), Path())
    assert scan.box is not None
    measurement, notes = run_in_memory(scan), list(scan.problems)
    measurement.save(paths["scan"], overwrite=force)
    image = form_image(measurement, inside_grid(scan.box, measurement.chirp.range_bin_m), seed)
    image.save(paths["image"], overwrite=force)

    meshes, _ = recorded_meshes(measurement.metadata)
    box_m = recorded_box(measurement.metadata)
    with publish_file(paths["range profiles"], overwrite=force) as temporary:
        range_profile_figure(measurement, temporary)
    with publish_file(paths["projections"], overwrite=force) as temporary:
        image_figure(image, temporary, meshes=meshes, aperture=measurement.aperture, box_m=box_m)
    layers = scene_layers(meshes=meshes, aperture=measurement.aperture, image=image, box_m=box_m)
    for name in ("picture", "scene"):
        notes += write_view(layers, paths[name], force)
    print_notes(notes)
    measured = measure(meshes[0], measurement, image, scan.box)
    summary = {
        "object": object_name,
        "seconds": round(time.perf_counter() - started, 3),
        **measured,
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


def inside_grid(box: Box, range_bin_m: float) -> Grid:
    """The inside of a box, less one range bin below its lid and above its floor, where their echoes are blurred to."""
    import numpy as np

    from waveformer.simulator.grid import Grid

    keep_off_m = box.thickness_m + np.array([0.0, 0.0, range_bin_m])
    return Grid.box(np.asarray(box.min_m) + keep_off_m, np.asarray(box.max_m) - keep_off_m, _SPACING_M)


def measure(mesh: SurfaceMesh, measurement: Measurement, image: Image, box: Box) -> dict[str, Any]:
    """The numbers that the explanation rests on."""
    import numpy as np

    from waveformer.cli.scan_run import strongest_echo
    from waveformer.eval.specular import bright_fraction, specular_fraction

    heights_m = measurement.aperture.tx_m[0, 2] - mesh.vertices_m[:, 2]
    bin_m = measurement.chirp.range_bin_m
    of_object = strongest_echo(measurement, (float(heights_m.min()) - bin_m, float(heights_m.max()) + bin_m))
    lid_m = float(measurement.aperture.tx_m[0, 2] - np.asarray(box.max_m)[2])
    of_lid = strongest_echo(measurement, (lid_m - bin_m, lid_m + bin_m))
    return {
        "positions": len(measurement.aperture),
        "samples": measurement.chirp.num_samples,
        "wavelength_m": float(measurement.chirp.wavelengths_m[0]),
        "range_resolution_m": bin_m,
        "peak_db": of_object.level_db,
        "peak_range_m": of_object.range_m,
        "box_material": box.material.name,
        "box_thickness_m": box.thickness_m,
        "lid_loss_db": lid_loss_db(box, measurement),
        "lid_db": of_lid.level_db,
        "lid_range_m": of_lid.range_m,
        "image_peak_m": image.peak_position_m.tolist(),
        "tolerance_deg": _TOLERANCE_DEG,
        "specular_area_fraction": specular_fraction(mesh, measurement.aperture, _TOLERANCE_DEG),
        "bright_level_db": _DARK_DB,
        "bright_area_fraction": bright_fraction(mesh, image, _DARK_DB),
    }


def lid_loss_db(box: Box, measurement: Measurement) -> float:
    """Power lost on the way in and out through the lid, at normal incidence, mean over the band."""
    import numpy as np

    from waveformer.simulator.response_plan import wall_transmission

    one_way = [
        wall_transmission(box.material, np.array(1.0), None, float(frequency_hz)).s
        for frequency_hz in measurement.chirp.frequencies_hz
    ]
    return float(-10.0 * np.log10(np.mean(np.abs(one_way) ** 4)))


def describe(summary: Mapping[str, Any]) -> str:
    """One paragraph on what is seen and why, then where it is."""
    place = ", ".join(f"{100 * value:.1f}" for value in summary["image_peak_m"])
    specular, bright = 100 * summary["specular_area_fraction"], 100 * summary["bright_area_fraction"]
    text = (
        f"A {summary['object']} lies {100 * _RANGE_M:.0f} cm below {summary['positions']} antenna positions, in a "
        f"closed box of {1000 * summary['box_thickness_m']:g} mm {summary['box_material']}. The way in and out "
        f"through the lid costs {summary['lid_loss_db']:.1f} dB; what is left of the strongest echo is "
        f"{summary['peak_db']:.1f} dB of the transmitted power, from {100 * summary['peak_range_m']:.1f} cm. The lid "
        f"itself echoes {summary['lid_db']:.1f} dB, but from {100 * summary['lid_range_m']:.1f} cm: range tells the "
        f"two apart, with a resolution of {100 * summary['range_resolution_m']:.1f} cm, so the image shows the inside "
        "of the box only and stops that much short of lid and floor. It peaks at "
        f"({place}) cm. Of the surface, {bright:.0f} % is brighter than {summary['bright_level_db']:g} dB of that "
        f"peak. The rest is dark, because at {1000 * summary['wavelength_m']:.1f} mm wavelength a smooth surface is a "
        "mirror, in a box or not: it shines only where its normal points back at an antenna, which is so within "
        f"{summary['tolerance_deg']:g} degrees for {specular:.1f} % of its area. "
        f"Completing the dark part is what waveformer is for. ({summary['seconds']:.0f} s)"
    )
    return "\n".join([text, *(f"  {name}: {path}" for name, path in summary["paths"].items())])


def _build(object_name: str) -> Any:
    from waveformer.simulator import primitives

    return primitives.mug() if object_name == "mug" else primitives.hammer()


def _settings(mesh: Path, object_name: str, seed: int) -> Any:
    from waveformer.cli.matter_config import BoxConfig
    from waveformer.cli.scan_config import ApertureConfig, ChirpConfig, SimulateConfig
    from waveformer.simulator.presets import CHIRP_PRESETS

    return SimulateConfig(
        meshes=(str(mesh),),
        place_m=(0.0, 0.0, -_RANGE_M),
        rotate_deg=_ROTATE_DEG[object_name],
        box=BoxConfig(material="cardboard", min_m=_BOX_LOW_M[object_name], max_m=_BOX_HIGH_M[object_name]),
        # The band of MITO's radar; half its samples reach 6 m, far enough, in half the time.
        radar=ChirpConfig(**{**CHIRP_PRESETS["mito"], "num_samples": _NUM_SAMPLES}),
        aperture=ApertureConfig(**_APERTURE),
        seed=seed,
    )
