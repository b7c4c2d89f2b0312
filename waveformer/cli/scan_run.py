"""Running a configured scan: in memory, or streamed to its store where it is large."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from waveformer import __version__
from waveformer.cli.report import progress

if TYPE_CHECKING:
    from waveformer.cli.scan_config import SimulateConfig
    from waveformer.simulator.measurement import Measurement
    from waveformer.simulator.occluders import Box
    from waveformer.simulator.radar import Aperture, Chirp

# What changes how a scan is computed, not what comes out.
_MEANS = {"threads", "workers"}
_BLOCK_POSITIONS = 4096


@dataclass(frozen=True)
class PreparedScan:
    """A scan with all its objects made.

    Attributes:
        targets, chirp, aperture: arguments of `simulate`.
        scene: the other ones, by name.
        origin: for the metadata of the scan.
        problems: remarks, one line each.
    """

    targets: Any
    chirp: Chirp
    aperture: Aperture
    scene: dict[str, Any]
    origin: dict[str, Any]
    problems: list[str]

    @property
    def box(self) -> Box | None:
        """The box around the objects."""
        box: Box | None = self.scene["box"]
        return box


@dataclass(frozen=True)
class Echo:
    """The highest peak of all range profiles.

    Attributes:
        level_db: received over transmitted power; None for no echo at all.
        range_m: where.
    """

    level_db: float | None
    range_m: float | None


def prepare_scan(config: SimulateConfig, folder: Path) -> PreparedScan:
    """Make the objects that a configuration describes.

    Args:
        config: the scan.
        folder: relative paths start here.

    Raises:
        WaveformerError: something cannot be loaded or makes no sense.
    """
    from waveformer.cli.scan_scene import load_setup
    from waveformer.simulator.arrays import with_receivers
    from waveformer.simulator.radar import Chirp

    aperture = config.aperture.build()
    if config.receivers is not None:
        aperture = with_receivers(aperture, config.receivers)
    setup = load_setup(config, folder)
    scene = {
        "sheets": setup.sheets,
        "box": setup.box,
        "antenna": None if config.antenna is None else config.antenna.build(),
        "polarization": config.polarization,
        "front_end": config.front_end,
        "mode": config.mode,
        "tile_positions": config.tile_positions,
        "seed": config.seed,
    }
    origin = {
        **setup.origin,
        "config": config.model_dump(mode="json", exclude=_MEANS),
        "waveformer_version": __version__,
    }
    return PreparedScan(
        setup.targets, Chirp(**config.radar.model_dump()), aperture, scene, origin, setup.problems
    )


def run_in_memory(scan: PreparedScan, threads: int | None = None) -> Measurement:
    """Simulate a scan with its origin in the metadata; progress goes to stderr."""
    from waveformer.simulator.forward import simulate
    from waveformer.simulator.runtime import activate

    if threads is not None:
        activate(threads)
    with progress("simulating antenna positions") as report:
        measurement = simulate(scan.targets, scan.chirp, scan.aperture, **scan.scene, progress=report)
    return dataclasses.replace(measurement, metadata={**measurement.metadata, **scan.origin})


def run_streamed(
    scan: PreparedScan, out: Path, *, workers: int | None, overwrite: bool, resume: bool
) -> None:
    """Simulate a scan into its store, block by block; progress goes to stderr.

    Raises:
        KeyboardInterrupt: with what is kept and how to go on, if the user stops it.
    """
    from waveformer.simulator.forward_stream import simulate_to_store
    from waveformer.simulator.storage import unfinished_folder

    written = 0
    try:
        with progress("antenna positions written") as report:

            def count(done: int, total: int) -> None:
                nonlocal written
                written = done
                report(done, total)

            simulate_to_store(
                scan.targets, scan.chirp, scan.aperture, out, workers=workers, overwrite=overwrite, resume=resume,
                metadata=scan.origin, progress=count, **scan.scene,
            )  # fmt: skip
    except KeyboardInterrupt as error:
        if not unfinished_folder(out).exists():
            raise
        kept = (
            f"{written} of {len(scan.aperture)} positions are kept" if written else "what was written is kept"
        )
        raise KeyboardInterrupt(f"{kept}: the same command with --resume goes on") from error


def strongest_echo(measurement: Measurement, between_m: tuple[float, float] | None = None) -> Echo:
    """The highest range-profile peak of a scan.

    Args:
        measurement: the scan.
        between_m: nearest and farthest range to look at; None for all.
    """
    import numpy as np

    range_m, magnitude = measurement.range_profile()
    highest = magnitude.max(axis=0)
    if between_m is not None:
        highest = np.where((range_m >= between_m[0]) & (range_m <= between_m[1]), highest, 0.0)
    peak = int(highest.argmax())
    if not highest[peak] > 0:
        return Echo(None, None)
    return Echo(float(20 * np.log10(highest[peak])), float(range_m[peak]))


def strongest_stored_echo(path: Path) -> tuple[Echo, dict[str, Any]]:
    """The highest range-profile peak of a stored scan, read a few rows at a time; and its metadata."""
    from waveformer.simulator.measurement import Measurement
    from waveformer.simulator.radar import Aperture
    from waveformer.simulator.stream_reader import StreamReader

    reader = StreamReader(path)
    strongest = Echo(None, None)
    for first in range(0, len(reader.aperture), _BLOCK_POSITIONS):
        rows = slice(first, min(first + _BLOCK_POSITIONS, len(reader.aperture)))
        # The peak does not depend on where the antennas are.
        block = Measurement(
            reader.rows(rows), reader.chirp, Aperture(reader.aperture.tx_m[rows]), reader.range_bias_m
        )
        echo = strongest_echo(block)
        if strongest.level_db is None or (echo.level_db is not None and echo.level_db > strongest.level_db):
            strongest = echo
    return strongest, reader.metadata
