"""NumPy float64 twins of the kernels: slow, obvious, and what the fast ones are tested against.

Nothing here touches Dr.Jit or Mitsuba; visibility comes in as an array.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from waveformer.simulator.grid import Grid
from waveformer.simulator.quadrature import SurfaceSamples
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Aperture, Chirp
from waveformer.simulator.reference_response import pair_response
from waveformer.simulator.response_plan import ResponsePlan


def integrand(
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    areas_m2: NDArray[np.float64],
    taper: NDArray[np.float64],
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64],
    two_sided: bool,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Physical-optics amplitude and mean range of samples (S, 3) for antennas that broadcast with them.

    Returns:
        (cos_i + cos_r) / 2 dA / (R_tx R_rx), zero where not lit from the same side, and
        (R_tx + R_rx) / 2, in metres.
    """
    range_m, cosine, direction = [], [], []
    for antenna in (tx_m, rx_m):
        offset = antenna - points_m
        distance = np.linalg.norm(offset, axis=-1)
        range_m.append(distance)
        direction.append(offset / distance[..., None])
        cosine.append((direction[-1] * normals).sum(axis=-1))
    lit = cosine[0] * cosine[1] > 0
    if not two_sided:
        lit &= cosine[0] > 0
    mean_cosine = np.where(lit, np.abs(0.5 * (cosine[0] + cosine[1])), 0.0)
    bisector = 0.5 + 0.5 * (direction[0] * direction[1]).sum(axis=-1)
    form_factor = (1.0 - taper * (bisector - mean_cosine**2)) ** 4
    amplitude = areas_m2 * mean_cosine / (range_m[0] * range_m[1]) * form_factor
    return amplitude, 0.5 * (range_m[0] + range_m[1])


def dense_echo(
    samples: SurfaceSamples,
    taper: NDArray[np.float64],
    chirp: Chirp,
    aperture: Aperture,
    visible: NDArray[np.bool_],
    two_sided: bool,
    response: ResponsePlan | None = None,
) -> NDArray[np.complex128]:
    """sum_s V W g exp(-j 4 pi f R / c), every exponential evaluated: the twin of `exact_echo`.

    Args:
        samples: S surface samples.
        taper: form factor scale, shape (S,).
        chirp, aperture: T samples, N pairs.
        visible: shape (N, S).
        two_sided: whether the back of the surface reflects.
        response: what W consists of, evaluated at every sample of the chirp; None for W = 1.

    Returns:
        Shape (N, T), not yet multiplied by j / (4 pi).
    """
    echo = np.empty((len(aperture), chirp.num_samples), dtype=np.complex128)
    wavenumbers = 4.0 * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S
    for row in range(len(aperture)):
        amplitude, range_m = integrand(
            samples.points_m, samples.normals, samples.areas_m2, taper,
            aperture.tx_m[row], aperture.receivers_m[row], two_sided,
        )  # fmt: skip
        seen = visible[row]
        phase = np.exp(-1j * range_m[seen, None] * wavenumbers[None, :])  # (S, T)
        if response is not None:
            phase *= np.stack(
                [
                    pair_response(
                        response, float(frequency), samples.points_m[seen], samples.normals[seen],
                        aperture.tx_m[row], aperture.receivers_m[row],
                    )
                    for frequency in chirp.frequencies_hz
                ],
                axis=1,
            )  # fmt: skip
        echo[row] = amplitude[seen] @ phase
    return echo


def dense_project(
    image: NDArray[np.complex128], grid: Grid, chirp: Chirp, aperture: Aperture
) -> NDArray[np.complex128]:
    """Echo of unit-gain voxels, every exponential evaluated: the twin of `imaging.project`."""
    voxels, values = _voxels(grid), np.asarray(image).reshape(-1)
    return np.stack([values @ _phase(voxels, chirp, aperture, row) for row in range(len(aperture))])


def dense_backproject(
    h: NDArray[np.complex128], chirp: Chirp, aperture: Aperture, grid: Grid
) -> NDArray[np.complex128]:
    """Eq. 1 term by term, shape (X, Y, Z): the twin of `imaging.backproject`."""
    voxels = _voxels(grid)
    image = np.zeros(len(voxels), dtype=np.complex128)
    for row in range(len(aperture)):
        image += _phase(voxels, chirp, aperture, row).conj() @ h[row]
    return image.reshape(grid.shape)


def _voxels(grid: Grid) -> NDArray[np.float64]:
    return np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1).reshape(-1, 3)


def _phase(voxels: NDArray[np.float64], chirp: Chirp, aperture: Aperture, row: int) -> NDArray[np.complex128]:
    """exp(-j 2 pi f_t (R_tx + R_rx) / c) of every voxel, shape (V, T)."""
    path = np.linalg.norm(voxels - aperture.tx_m[row], axis=1)
    path = path + np.linalg.norm(voxels - aperture.receivers_m[row], axis=1)
    return np.asarray(np.exp(-2j * np.pi / SPEED_OF_LIGHT_M_PER_S * path[:, None] * chirp.frequencies_hz))
