"""A scene that is ready to be summed: what `simulate` and `simulate_to_store` share."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.blas import single_blas_thread
from waveformer.simulator.box_walls import wall_pieces
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.errors import RadarError
from waveformer.simulator.front_end import FrontEnd
from waveformer.simulator.front_end_chain import apply_front_end
from waveformer.simulator.front_end_noise import signal_power
from waveformer.simulator.front_end_positions import true_aperture
from waveformer.simulator.numerics import Numerics, resolve_numerics
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.placement import PlacedTarget, check_box, place_target
from waveformer.simulator.quadrature import face_chunks, faces_that_can_face, sample_surface
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.response_plan import constant_response, plan_response
from waveformer.simulator.runtime import activate
from waveformer.simulator.scene_file import is_scene, load_scene
from waveformer.simulator.sheet_echo import sheet_echo
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.target import as_targets, rotate

# Rows of H computed together, whether they stay in memory or are written as they come.
BLOCK_POSITIONS = 16384
_REFERENCE_POSITIONS = 2048
# Interpolation of a box's own echo: as good as its pieces are, and the echo is gated out where the object matters.
_WALL_TOLERANCE = 5e-3

Progress = Callable[[int, int], None]
Accumulate = Callable[[NDArray[np.int64], NDArray[np.complex64]], None]


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """A scene that is ready to be summed, block of rows by block of rows.

    Attributes:
        placed: targets in the radar frame.
        scene: Mitsuba scene of the targets, which decides visibility.
        surroundings: antennas and occluders.
        chirp: T samples.
        antennas: N pairs where they really are: the front end may err about them.
        front_end: what the radar does to the ideal signal.
        numerics: kernel settings.
        tile_positions, seed: see `simulate`.
    """

    placed: list[PlacedTarget]
    scene: Any
    surroundings: Surroundings
    chirp: Chirp
    antennas: Aperture
    front_end: FrontEnd
    numerics: Numerics
    tile_positions: int | None
    seed: int

    @classmethod
    def prepare(
        cls,
        targets: Any,
        chirp: Chirp,
        aperture: Aperture,
        *,
        sheets: Sequence[Sheet] = (),
        box: Box | None = None,
        antenna: Antenna | None = None,
        polarization: Sequence[float] | NDArray[np.float64] = (0.0, 1.0, 0.0),
        front_end: FrontEnd | None = None,
        mode: str | Numerics = "fast",
        tile_positions: int | None = None,
        seed: int = 0,
    ) -> ForwardModel:
        """Load, place and check everything; arguments and errors as in `simulate`."""
        numerics = resolve_numerics(mode)
        if tile_positions is not None and (
            not isinstance(tile_positions, (int, np.integer)) or tile_positions < 1
        ):
            raise RadarError(f"tile_positions must be a whole number of at least 1, got {tile_positions!r}")
        front_end = front_end or FrontEnd()
        if not isinstance(front_end, FrontEnd):
            raise RadarError(f"front_end must be a FrontEnd, got {front_end!r}")
        surroundings = Surroundings(antenna or Antenna.isotropic(), sheets, box, polarization)
        if is_scene(targets):
            loaded = load_scene(targets)
            if box is not None and loaded.box is not None:
                raise RadarError("both the scene and the argument bring a box: give one of them")
            targets, box = loaded.targets, box or loaded.box
            surroundings = replace(surroundings, sheets=(*surroundings.sheets, *loaded.sheets), box=box)
        antennas = true_aperture(front_end, aperture, seed)
        placed = [place_target(target, box, chirp, antennas) for target in as_targets(targets)]
        if box is not None:
            check_box(box, chirp, antennas)
        model = cls(placed, None, surroundings, chirp, antennas, front_end, numerics, tile_positions, seed)
        return model.traced()

    def traced(self) -> ForwardModel:
        """The same model with its Mitsuba scene, which no other process can be given."""
        activate()
        from waveformer.simulator.scene import build_scene

        scene = build_scene([(item.vertices_m, item.mesh.faces) for item in self.placed])
        return replace(self, scene=scene)

    def record(
        self, rows: slice, reference_power: float | None, progress: Progress | None = None
    ) -> NDArray[np.complex64]:
        """What the radar records in some rows of the aperture, shape (n, T).

        Args:
            rows: of the aperture.
            reference_power: from `reference_power`.
            progress: called with (positions done, positions in the block).
        """
        h = self.echo(self._pairs(rows), progress)
        if self.front_end.is_ideal:
            return h
        return apply_front_end(
            self.front_end, h, rows.start, self.antennas, self.chirp, self.seed,
            antenna=self.surroundings.antenna, reference_power=reference_power,
        )  # fmt: skip

    def reference_power(self) -> float | None:
        """The signal that `FrontEnd.snr_db` refers to, if it must be known before the first block.

        The median over 2048 evenly chosen rows: summing all of them first would double the work. None where one
        block holds all rows and `apply_front_end` takes their median itself.
        """
        count = len(self.antennas)
        if self.front_end.snr_db is None or count <= BLOCK_POSITIONS:
            return None
        chosen = np.linspace(0, count - 1, _REFERENCE_POSITIONS).astype(np.int64)
        return float(np.median(signal_power(self.echo(self._pairs(chosen)))))

    def _pairs(self, rows: slice | NDArray[np.int64]) -> Aperture:
        receivers = None if self.antennas.rx_m is None else self.antennas.rx_m[rows]
        return Aperture(self.antennas.tx_m[rows], receivers)

    def echo(self, aperture: Aperture, progress: Progress | None = None) -> NDArray[np.complex64]:
        """Ideal signal of any antenna pairs, shape (n, T)."""
        h = np.zeros((len(aperture), self.chirp.num_samples), dtype=np.complex64)
        with single_blas_thread():
            for index, item in enumerate(self.placed):
                self._add_target(h, item, aperture, _share(progress, index, len(self.placed)))
            if self.surroundings.box is not None:
                self._add_walls(h, self.surroundings.box, aperture)
            for sheet in self.surroundings.sheets:
                if sheet.echo:
                    tolerance = self.numerics.tolerance
                    h += sheet_echo(sheet, self.surroundings, self.chirp, aperture, tolerance)
        return h

    def describe(self) -> dict[str, Any]:
        """JSON values for the metadata of a scan."""
        frequency_hz = self.chirp.center_hz
        return {
            "targets": [item.describe(frequency_hz) for item in self.placed],
            "surroundings": self.surroundings.describe(frequency_hz),
            "front_end": self.front_end.describe(),
            "numerics": self.numerics.model_dump(),
            "seed": self.seed,
        }

    def fingerprint(self) -> dict[str, Any]:
        """All that determines H besides chirp and positions, as JSON values; meshes by their SHA-256."""
        hashes = [
            hashlib.sha256(item.vertices_m.tobytes() + item.mesh.faces.tobytes()).hexdigest()
            for item in self.placed
        ]
        return {**self.describe(), "meshes": hashes, "tile_positions": self.tile_positions}

    def _add_target(
        self, h: NDArray[np.complex64], item: PlacedTarget, aperture: Aperture, progress: Progress | None
    ) -> None:
        """Add the echo of one target to h (n, T)."""
        keep = faces_that_can_face(
            item.vertices_m[item.mesh.faces],
            rotate(item.mesh.normals, item.pose),
            item.mesh.two_sided,
            aperture.tx_m,
            aperture.receivers_m,
        )
        wavelength_m = SPEED_OF_LIGHT_M_PER_S / self.chirp.center_hz
        spacing = self.numerics.spacing_m(float(item.mesh.areas_m2[keep].sum()), wavelength_m)
        chunks = face_chunks(item.mesh, keep, spacing)
        constant = constant_response(item.material, self.surroundings)
        response = None
        if constant is None:
            tolerance = self.numerics.tolerance
            bounds_m = np.array([item.vertices_m.min(axis=0), item.vertices_m.max(axis=0)])
            antennas_m = np.concatenate([aperture.tx_m, aperture.receivers_m])
            response = plan_response(
                item.material, self.surroundings, item.crossings, self.chirp, tolerance, bounds_m, antennas_m
            )
        scale = np.complex64(1j / (4.0 * np.pi) * (1.0 if constant is None else constant))
        for index, chunk in enumerate(chunks):
            samples = sample_surface(item.mesh, item.pose, spacing, chunk)
            source = EchoSource(samples, item.mesh.two_sided, item.closest_m, response)
            add = _accumulator(h, scale, _share(progress, index, len(chunks)))
            self._sum(source, aperture, self.numerics, add)

    def _add_walls(self, h: NDArray[np.complex64], box: Box, aperture: Aperture) -> None:
        """Add the echo of the box itself to h (n, T): its outer faces, and the inner ones through the other walls."""
        antennas = np.concatenate([aperture.tx_m, aperture.receivers_m])
        wavelength = SPEED_OF_LIGHT_M_PER_S / self.chirp.center_hz
        closest_m = check_box(box, self.chirp, aperture)
        tolerance = max(_WALL_TOLERANCE, self.numerics.tolerance)
        numerics = (
            self.numerics
            if self.numerics.direct
            else self.numerics.model_copy(update={"tolerance": tolerance})
        )
        for inside in (False, True):
            samples, facet_m = wall_pieces(
                box, self.numerics.facet_wavelengths * wavelength, antennas, inside=inside
            )
            if len(samples.points_m):
                response = plan_response(
                    box.material,
                    self.surroundings,
                    "leaving" if inside else "none",
                    self.chirp,
                    numerics.tolerance,
                    np.array([box.min_m, box.max_m]),
                    antennas,
                    facet_m,
                )
                add = _accumulator(h, np.complex64(1j / (4.0 * np.pi)), None)
                self._sum(EchoSource(samples, False, closest_m, response), aperture, numerics, add)

    def _sum(self, source: EchoSource, aperture: Aperture, numerics: Numerics, add: Accumulate) -> None:
        from waveformer.simulator.exact_echo import exact_echo
        from waveformer.simulator.fast_echo import fast_echo

        kernel = exact_echo if numerics.direct else fast_echo
        kernel(self.scene, source, self.chirp, aperture, numerics, self.tile_positions, add)


def _accumulator(h: NDArray[np.complex64], scale: np.complex64, progress: Progress | None) -> Accumulate:
    """A function that adds scaled echoes to rows of h and reports how many are done."""
    done = np.zeros(len(h), dtype=bool)

    def add(rows: NDArray[np.int64], echo: NDArray[np.complex64]) -> None:
        h[rows] += scale * echo
        done[rows] = True
        if progress is not None:
            progress(int(done.sum()), len(h))

    return add


def _share(progress: Progress | None, index: int, count: int) -> Progress | None:
    """Progress of one of several targets as progress of the whole."""
    if progress is None:
        return None
    return lambda done, total: progress((index * total + done) // count, total)
