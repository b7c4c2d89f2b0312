"""The regression suite a user can run: the simulator against theory, each tolerance with its reason."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from waveformer.simulator.errors import RadarError
from waveformer.simulator.validation_result import CheckResult, Trial

__all__ = ["CheckResult", "run_validation"]

MODES = ("fast", "exact")

Check = Callable[[Trial], Iterator[CheckResult]]


def run_validation(
    *,
    quick: bool,
    modes: Sequence[str] = MODES,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> list[CheckResult]:
    """Compare the public simulator, with its defaults, against closed forms and exact solutions.

    Args:
        quick: True runs a subset with fewer rotations and positions.
        modes: modes of the simulator to test; "exact" always has fewer rotations and positions.
        seed: of random rotations and positions.
        progress: receives one line before each check.

    Returns:
        One result per line of the table; `passed` says whether it holds.
    """
    unknown = [mode for mode in modes if mode not in MODES]
    if unknown or not modes:
        raise RadarError(f"validation modes must be taken from {', '.join(MODES)}, got {list(modes)}")
    results: list[CheckResult] = []
    for mode in modes:
        per_mode, once = _checks()
        for check in per_mode + (once if mode == modes[0] else []):
            if progress is not None:
                progress(f"{mode}: {_title(check)}")
            results += _timed(check(Trial(mode, quick, seed)))
    return results


def _checks() -> tuple[list[Check], list[Check]]:
    """Checks of every mode, and those that no mode enters."""
    # Imported here so that asking for CheckResult loads neither the simulator nor scipy
    from waveformer.simulator import validation_box as box
    from waveformer.simulator import validation_curved as curved
    from waveformer.simulator import validation_flat as flat
    from waveformer.simulator import validation_incoherent as incoherent
    from waveformer.simulator import validation_matter as matter
    from waveformer.simulator import validation_radar as radar
    from waveformer.simulator import validation_sheet as sheet
    from waveformer.simulator import validation_signal as signal

    per_mode: list[Check] = [
        curved.sphere_monostatic,
        curved.sphere_under_aperture,
        curved.sphere_pairs,
        curved.sphere_refinement,
        curved.cylinder_broadside,
        flat.plate_far_field,
        flat.plate_near_field,
        flat.plate_edge_scan,
        flat.disc_zones,
        signal.sphere_range,
        signal.level_over_range,
        matter.lossy_sphere,
        matter.thin_wall,
        matter.named_materials,
        matter.oblique_reflection,
        matter.rough_surface,
        sheet.sheet_transmission,
        sheet.sheet_under_aperture,
        sheet.sheet_own_echo,
        box.box_of_nothing,
        box.sphere_in_box,
        box.box_walls,
        radar.antenna_pattern,
    ]
    once: list[Check] = [
        signal.point_range,
        signal.adjoint_identity,
        signal.focus,
        radar.thermal_noise_level,
        radar.range_bias,
        radar.iq_image,
        radar.row_depth_errors,
        incoherent.incoherent_spheres,
    ]
    return per_mode, once


def _title(check: Check) -> str:
    return str(getattr(check, "__name__", check)).replace("_", " ")


def _timed(findings: Iterator[CheckResult]) -> Iterator[CheckResult]:
    """Each result with the seconds since the one before it."""
    start = time.perf_counter()
    for finding in findings:
        now = time.perf_counter()
        yield replace(finding, seconds=now - start)
        start = now
