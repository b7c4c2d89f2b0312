"""From meshes to the raw signal H: the pipeline on one screen."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.antenna import Antenna
from waveformer.simulator.blas import single_blas_thread
from waveformer.simulator.box_walls import wall_pieces
from waveformer.simulator.echo_source import EchoSource
from waveformer.simulator.errors import RadarError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.numerics import Numerics, resolve_numerics
from waveformer.simulator.occluders import Box, Sheet
from waveformer.simulator.placement import PlacedTarget, check_box, place_target
from waveformer.simulator.quadrature import face_chunks, faces_that_can_face, sample_surface
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.response_plan import constant_response, plan_response
from waveformer.simulator.runtime import activate
from waveformer.simulator.sheet_echo import sheet_echo
from waveformer.simulator.surroundings import Surroundings
from waveformer.simulator.target import as_targets, rotate

# Rows of H computed together, whether they stay in memory or are written as they come.
BLOCK_POSITIONS = 16384

Progress = Callable[[int, int], None]
Accumulate = Callable[[NDArray[np.int64], NDArray[np.complex64]], None]


def simulate(
    targets: Any,
    chirp: Chirp,
    aperture: Aperture,
    *,
    sheets: Sequence[Sheet] = (),
    box: Box | None = None,
    antenna: Antenna | None = None,
    polarization: Sequence[float] | NDArray[np.float64] = (0.0, 1.0, 0.0),
    mode: str | Numerics = "fast",
    tile_positions: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Measurement:
    """Raw FMCW signal of a scene by physical optics with ray-traced visibility, single bounce.

    h(f) = (j / 4 pi) sum sqrt(G_tx G_rx) Gamma V (cos_i + cos_r) / 2 dA / (R_tx R_rx) exp(-j k (R_tx + R_rx)),
    calibrated: ``|h|^2`` is received over transmitted power. Each way is weakened and delayed by the sheets and
    walls that it crosses. Multiple bounces, edge diffraction beyond physical optics and the echo of the back of a
    dielectric body are left out.

    Args:
        targets: a mesh (trimesh.Trimesh or path), a Target, or a sequence of them, in metres in the radar
            frame (z up, the aperture looks down).
        chirp: T samples.
        aperture: N pairs of antennas.
        sheets: infinite flat occluders.
        box: a closed box around the targets; its walls weaken every echo and send back their own.
        antenna: gain of both antennas; None means isotropic with 0 dBi.
        polarization: direction of E at both antennas, shape (3,); it matters for sheets, boxes and dielectrics.
        mode: "fast" (factorised kernel), "exact" (every pair, visibility per position) or a Numerics.
        tile_positions: most positions in flight at once; bounds memory, changes the result by rounding only.
        seed: recorded with the result; the ideal signal draws nothing at random.
        progress: called with (positions done, positions in all).

    Returns:
        Measurement with h of shape (N, T).

    Raises:
        MeshError: a mesh cannot be used, touches or lies behind the aperture, or reaches through the box.
        RadarError: the scene exceeds the unambiguous range, or the settings make no sense.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    started = time.perf_counter()
    surroundings = Surroundings(antenna or Antenna.isotropic(), sheets, box, polarization)
    model = ForwardModel.prepare(targets, surroundings, chirp, aperture, mode, tile_positions)
    h = np.empty((len(aperture), chirp.num_samples), dtype=np.complex64)
    for first in range(0, len(aperture), BLOCK_POSITIONS):
        rows = slice(first, first + BLOCK_POSITIONS)
        h[rows] = model.echo(rows, _offset(progress, first, len(aperture)))
    if progress is not None:
        progress(len(aperture), len(aperture))
    metadata = {**model.describe(), "seed": seed, "seconds": time.perf_counter() - started}
    return Measurement(h, chirp, aperture, metadata=metadata)


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """A scene that is ready to be summed, block of rows by block of rows.

    Attributes:
        placed: targets in the radar frame.
        scene: Mitsuba scene of the targets, which decides visibility.
        surroundings: antennas and occluders.
        chirp, aperture: the radar.
        numerics: kernel settings.
        tile_positions: see `simulate`.
    """

    placed: list[PlacedTarget]
    scene: Any
    surroundings: Surroundings
    chirp: Chirp
    aperture: Aperture
    numerics: Numerics
    tile_positions: int | None

    @classmethod
    def prepare(
        cls,
        targets: Any,
        surroundings: Surroundings,
        chirp: Chirp,
        aperture: Aperture,
        mode: str | Numerics,
        tile_positions: int | None,
    ) -> ForwardModel:
        """Load, place and check everything; arguments and errors as in `simulate`."""
        numerics = resolve_numerics(mode)
        if tile_positions is not None and (
            not isinstance(tile_positions, (int, np.integer)) or tile_positions < 1
        ):
            raise RadarError(f"tile_positions must be a whole number of at least 1, got {tile_positions!r}")
        box = surroundings.box
        placed = [place_target(target, box, chirp, aperture) for target in as_targets(targets)]
        activate()
        from waveformer.simulator.scene import build_scene

        scene = build_scene([(item.vertices_m, item.mesh.faces) for item in placed])
        if box is not None:
            check_box(box, chirp, aperture)
        return cls(placed, scene, surroundings, chirp, aperture, numerics, tile_positions)

    def echo(self, rows: slice, progress: Progress | None = None) -> NDArray[np.complex64]:
        """Ideal signal of some rows of the aperture, shape (n, T)."""
        receivers = None if self.aperture.rx_m is None else self.aperture.rx_m[rows]
        aperture = Aperture(self.aperture.tx_m[rows], receivers)
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
            "numerics": self.numerics.model_dump(),
        }

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
        spacing = self.numerics.spacing_wavelengths * SPEED_OF_LIGHT_M_PER_S / self.chirp.center_hz
        chunks = face_chunks(item.mesh, keep, spacing)
        constant = constant_response(item.material, self.surroundings)
        response = None
        if constant is None:
            tolerance = self.numerics.tolerance
            response = plan_response(item.material, self.surroundings, item.crossings, self.chirp, tolerance)
        scale = np.complex64(1j / (4.0 * np.pi) * (1.0 if constant is None else constant))
        for index, chunk in enumerate(chunks):
            samples = sample_surface(item.mesh, item.pose, spacing, chunk)
            source = EchoSource(samples, item.mesh.two_sided, item.closest_m, response)
            add = _accumulator(h, scale, _share(progress, index, len(chunks)))
            self._sum(source, aperture, add)

    def _add_walls(self, h: NDArray[np.complex64], box: Box, aperture: Aperture) -> None:
        """Add the echo of the box itself to h (n, T): its outer faces, and the inner ones through the other walls."""
        antennas = np.concatenate([aperture.tx_m, aperture.receivers_m])
        wavelength = SPEED_OF_LIGHT_M_PER_S / self.chirp.center_hz
        closest_m = check_box(box, self.chirp, aperture)
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
                    self.numerics.tolerance,
                    facet_m,
                )
                add = _accumulator(h, np.complex64(1j / (4.0 * np.pi)), None)
                self._sum(EchoSource(samples, False, closest_m, response), aperture, add)

    def _sum(self, source: EchoSource, aperture: Aperture, add: Accumulate) -> None:
        from waveformer.simulator.exact_echo import exact_echo
        from waveformer.simulator.fast_echo import fast_echo

        kernel = exact_echo if self.numerics.direct else fast_echo
        kernel(self.scene, source, self.chirp, aperture, self.numerics, self.tile_positions, add)


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


def _offset(progress: Progress | None, first: int, total: int) -> Progress | None:
    """Progress of a block of rows as progress of all rows."""
    if progress is None:
        return None
    return lambda done, _: progress(first + done, total)
