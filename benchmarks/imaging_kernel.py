"""Imaging: pairs of voxel and antenna per second, the error against Eq. 1, and NumPy programs beside it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy_imaging import direct, factorised, plain, range_profiles
from scenes import APERTURE, CHIRP, bumpy_ellipsoid, measure, relative_l2, report

from waveformer.simulator import Grid, Target, backproject, simulate
from waveformer.simulator.imaging import GridBlock, grid_blocks
from waveformer.simulator.reference import dense_backproject

PITCH_M = 0.3 / 127
MIDDLE_M = (0.0, 0.0, -0.335)
_PLANES = 6


def cube(count: int) -> Grid:
    """A cube of voxels around the object: 30 cm for a count of 128."""
    offsets = (np.arange(count) - (count - 1) / 2) * PITCH_M
    return Grid(*(middle + offsets for middle in MIDDLE_M))


def points_of(grid: Grid) -> Any:
    """All voxels, shape (V, 3)."""
    return np.stack(np.meshgrid(grid.x, grid.y, grid.z, indexing="ij"), axis=-1).reshape(-1, 3)


def block_image(block: GridBlock, h: Any) -> Any:
    """One block by the NumPy twin of the factorised kernel, in the block's cell order."""
    return sum(factorised(block, tile, h, CHIRP, APERTURE) for tile in block.tiles)


def main(quick: bool) -> None:
    grid = cube(64 if quick else 128)
    scan = simulate(Target(bumpy_ellipsoid()), CHIRP, APERTURE)
    images = []
    timing = measure(lambda: images.append(backproject(scan, grid)), 3 if quick else 5)
    image = images[-1]
    kernel = timing.rate(image.size * len(APERTURE))

    rng = np.random.default_rng(0)
    planes = [np.sort(rng.choice(len(axis), _PLANES, replace=False)) for axis in (grid.x, grid.y, grid.z)]
    some = Grid(*(axis[plane] for axis, plane in zip((grid.x, grid.y, grid.z), planes, strict=True)))
    truth = dense_backproject(scan.h.astype(np.complex128), CHIRP, APERTURE, some)
    error = relative_l2(image[np.ix_(*planes)], truth)

    profiles = range_profiles(scan.h, CHIRP)
    middle = (np.asarray(axis)[len(axis) // 2 + np.arange(20)] for axis in (grid.x, grid.y, grid.z))
    voxels, every_few = points_of(Grid(*middle)), slice(None, None, 8)
    block = next(grid_blocks(grid, CHIRP, APERTURE))
    flat = np.empty(len(block.order), dtype=np.complex64)
    flat[block.order] = block_image(block, scan.h)
    part = Grid(*(axis[piece] for axis, piece in zip((grid.x, grid.y, grid.z), block.slices, strict=True)))
    runs = 3 if quick else 5
    block_kernel = measure(lambda: backproject(scan, part), runs).rate(len(flat) * len(APERTURE))

    def numpy_rate(name: str, work: Any, count: int, beside: dict[str, Any], error: float) -> dict[str, Any]:
        rate = measure(work, runs).rate(count)
        slower = beside["pairs_per_cpu_s"] / rate["pairs_per_cpu_s"]
        return {"name": name, **rate, "slower_than_kernel": slower, "relative_l2_error": error}

    def by_voxel(name: str, program: Callable[..., Any]) -> dict[str, Any]:
        few = profiles[every_few], voxels, CHIRP, APERTURE.tx_m[every_few]
        error = relative_l2(program(profiles, points_of(some), CHIRP, APERTURE.tx_m), truth.ravel())
        return numpy_rate(name, lambda: program(*few), len(voxels) * len(few[0]), kernel, error)

    report(
        [
            {"name": "imaging", **kernel, "relative_l2_error": error},
            {"name": "imaging, one block of 60 x 60 x 60", **block_kernel},
            numpy_rate(
                "NumPy float32, the same factorisation, that block",
                lambda: block_image(block, scan.h),
                len(flat) * len(APERTURE),
                block_kernel,
                relative_l2(flat.reshape(block.shape), image[block.slices]),
            ),
            by_voxel("NumPy float64, range profiles and linear interpolation", plain),
            by_voxel("NumPy float32, range profiles and linear interpolation", direct),
        ]
    )


if __name__ == "__main__":
    main("--quick" in sys.argv)
