"""From meshes to the raw signal H: the pipeline on one screen."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.blas import single_blas_thread
from waveformer.simulator.errors import MeshError, RadarError
from waveformer.simulator.measurement import Measurement
from waveformer.simulator.mesh import SurfaceMesh, load_mesh
from waveformer.simulator.numerics import Numerics, resolve_numerics
from waveformer.simulator.quadrature import face_chunks, faces_that_can_face, sample_surface
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.runtime import activate
from waveformer.simulator.target import Target, as_targets, rotate

# A surface nearer than this to an antenna lies in its reactive field, where k R is not large.
MIN_DISTANCE_WAVELENGTHS = 5.0

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class PlacedTarget:
    """A target in the radar frame.

    Attributes:
        target: as given.
        mesh: its surface in mesh coordinates.
        vertices_m: vertices in the radar frame, shape (V, 3).
        closest_m: lower bound of the distance between its bounding box and any antenna.
    """

    target: Target
    mesh: SurfaceMesh
    vertices_m: NDArray[np.float64]
    closest_m: float


def simulate(
    targets: Any,
    chirp: Chirp,
    aperture: Aperture,
    *,
    mode: str | Numerics = "fast",
    tile_positions: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Measurement:
    """Raw FMCW signal of a scene by physical optics with ray-traced visibility, single bounce.

    h(f) = (j / 4 pi) sum Gamma V (cos_i + cos_r) / 2 dA / (R_tx R_rx) exp(-j k (R_tx + R_rx)),
    calibrated: ``|h|^2`` is received over transmitted power of isotropic antennas. Multiple bounces and
    edge diffraction beyond physical optics are left out.

    Args:
        targets: a mesh (trimesh.Trimesh or path), a Target, or a sequence of them, in metres in the radar
            frame (z up, the aperture looks down).
        chirp: T samples.
        aperture: N pairs of antennas.
        mode: "fast" (factorised kernel), "exact" (every pair, visibility per position) or a Numerics.
        tile_positions: most positions in flight at once; bounds memory, changes the result by rounding only.
        seed: recorded with the result; the ideal signal draws nothing at random.
        progress: called with (positions done, positions in all).

    Returns:
        Measurement with h of shape (N, T).

    Raises:
        MeshError: a mesh cannot be used, or touches or lies behind the aperture.
        RadarError: the scene exceeds the unambiguous range, or the settings make no sense.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    started = time.perf_counter()
    numerics = resolve_numerics(mode)
    if tile_positions is not None and (
        not isinstance(tile_positions, (int, np.integer)) or tile_positions < 1
    ):
        raise RadarError(f"tile_positions must be a whole number of at least 1, got {tile_positions!r}")
    placed = [_place(target, chirp, aperture) for target in as_targets(targets)]

    activate()
    from waveformer.simulator.scene import build_scene

    scene = build_scene([(item.vertices_m, item.mesh.faces) for item in placed])
    h = np.zeros((len(aperture), chirp.num_samples), dtype=np.complex64)
    with single_blas_thread():
        for index, item in enumerate(placed):
            share = _share(progress, index, len(placed))
            _add_echo(h, scene, item, chirp, aperture, numerics, tile_positions, share)
    if progress is not None:
        progress(len(aperture), len(aperture))
    metadata = {
        "targets": [_describe(item) for item in placed],
        "numerics": numerics.model_dump(),
        "seed": seed,
        "seconds": time.perf_counter() - started,
    }
    return Measurement(h, chirp, aperture, metadata=metadata)


def _add_echo(
    h: NDArray[np.complex64],
    scene: Any,
    item: PlacedTarget,
    chirp: Chirp,
    aperture: Aperture,
    numerics: Numerics,
    tile_positions: int | None,
    progress: Progress | None,
) -> None:
    """Add the echo of one target to h (N, T)."""
    from waveformer.simulator.exact_echo import exact_echo
    from waveformer.simulator.fast_echo import fast_echo

    pose = item.target.pose
    keep = faces_that_can_face(
        item.vertices_m[item.mesh.faces],
        rotate(item.mesh.normals, pose),
        item.mesh.two_sided,
        aperture.tx_m,
        aperture.receivers_m,
    )
    wavelength = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    spacing = numerics.spacing_wavelengths * wavelength
    chunks = face_chunks(item.mesh, keep, spacing)
    scale = np.complex64(1j * -1.0 / (4.0 * np.pi))
    for index, chunk in enumerate(chunks):
        samples = sample_surface(item.mesh, pose, spacing, chunk)
        add = _accumulator(h, scale, _share(progress, index, len(chunks)))
        shared = (chirp, aperture, numerics, tile_positions, add)
        if numerics.direct:
            exact_echo(scene, samples, item.mesh.two_sided, *shared)
        else:
            fast_echo(scene, samples, item.mesh.two_sided, item.closest_m, *shared)


def _accumulator(
    h: NDArray[np.complex64], scale: np.complex64, progress: Progress | None
) -> Callable[[NDArray[np.int64], NDArray[np.complex64]], None]:
    """A function that adds scaled echoes to rows of h and reports how many are done."""
    done = 0

    def add(rows: NDArray[np.int64], echo: NDArray[np.complex64]) -> None:
        nonlocal done
        h[rows] += scale * echo
        done += len(rows)
        if progress is not None:
            progress(done, len(h))

    return add


def _place(target: Target, chirp: Chirp, aperture: Aperture) -> PlacedTarget:
    """Load a target into the radar frame and check that the radar can see it."""
    mesh = target.mesh if isinstance(target.mesh, SurfaceMesh) else load_mesh(target.mesh)
    vertices = rotate(mesh.vertices_m, target.pose) + target.pose[:3, 3]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    antennas = aperture.tx_m if aperture.rx_m is None else np.concatenate([aperture.tx_m, aperture.rx_m])
    lowest = float(antennas[:, 2].min())
    if high[2] >= lowest:
        side = "touches or reaches through" if low[2] < lowest else "lies behind"
        raise MeshError(
            "mesh.at_aperture",
            f"{mesh.name}: the mesh (z {low[2]:.3f} .. {high[2]:.3f} m) {side} the aperture at z = {lowest:.3f} m, "
            "which looks down: move it below (pose, or --place 0 0 -0.4)",
        )
    outside = np.maximum(0.0, np.maximum(low - antennas, antennas - high))
    closest = float(np.sqrt((outside**2).sum(axis=1).min()))
    nearest_allowed = MIN_DISTANCE_WAVELENGTHS * float(chirp.wavelengths_m[0])
    if closest < nearest_allowed:
        raise MeshError(
            "mesh.at_aperture",
            f"{mesh.name}: {closest * 1e3:.1f} mm from an antenna is inside its reactive near field; "
            f"keep at least {nearest_allowed * 1e3:.0f} mm",
        )
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1).reshape(-1, 3)
    farthest = max(float(np.linalg.norm(antennas - corner, axis=1).max()) for corner in corners)
    if farthest > chirp.unambiguous_range_m:
        raise RadarError(
            f"{mesh.name}: reaches {farthest:.2f} m from the radar, beyond the unambiguous range "
            f"{chirp.unambiguous_range_m:.2f} m of {chirp.num_samples} samples over {chirp.bandwidth_hz / 1e9:g} GHz: "
            "its echo would fold back; move it nearer or use more samples"
        )
    return PlacedTarget(target, mesh, vertices, closest)


def _describe(item: PlacedTarget) -> dict[str, Any]:
    return {
        "name": item.mesh.name,
        "material": item.target.material.name,
        "bounds_m": [item.vertices_m.min(axis=0).tolist(), item.vertices_m.max(axis=0).tolist()],
        "pose": item.target.pose.tolist(),
        "two_sided": item.mesh.two_sided,
        "problems": list(item.mesh.problems),
    }


def _share(progress: Progress | None, index: int, count: int) -> Progress | None:
    """Progress of one of several targets as progress of the whole."""
    if progress is None:
        return None
    return lambda done, total: progress((index * total + done) // count, total)
