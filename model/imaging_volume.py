"""What is imaged: a crop around the object in full, and a sparse background of the rest of the volume."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.model.components import connected_components
from waveformer.model.threshold import Background, specular_mask
from waveformer.model.voxels import voxel_edges_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.focusing import focus
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement

# MITO's volume: beyond the aperture to each side, and the depths below it.
MARGIN_M = 0.125
DEPTHS_M = (0.25, 0.50)
# Around what reflects: the object's hidden sides, and in depth the range resolution.
CROP_MARGIN_M = np.array([0.03, 0.03, 0.045])
# The background is sampled in cubes as large as a cell of the imaging, one of 27: a cell costs little more than a voxel.
_CUBE, _CUBES_PER_GROUP_EDGE, _BACKGROUND_SPACING_M = 4, 3, 4e-3
_COARSE_SPACING_M = 6e-3
# How far beside the aperture an object is looked for.
_BESIDE_M = 0.03


class Volume(NamedTuple):
    """A box.

    Attributes:
        min_m, max_m: corners, shape (3,).
    """

    min_m: NDArray[np.float64]
    max_m: NDArray[np.float64]


def imaging_volume(measurement: Measurement) -> Volume:
    """The volume that MITO images, for where this aperture is."""
    antennas = np.concatenate([measurement.aperture.tx_m, measurement.aperture.receivers_m])
    low, high = antennas.min(axis=0), antennas.max(axis=0)
    near_m, far_m = DEPTHS_M
    return Volume(
        np.array([low[0] - MARGIN_M, low[1] - MARGIN_M, low[2] - far_m]),
        np.array([high[0] + MARGIN_M, high[1] + MARGIN_M, low[2] - near_m]),
    )


def sample_background(
    measurement: Measurement, volume: Volume, crop: Grid, rng: np.random.Generator
) -> Background:
    """|S| at a random one in 27 cubes of the volume outside the crop.

    Args:
        measurement: the scan.
        volume: all that is imaged.
        crop: voxels that are imaged in full.
        rng: draws the cube in each group of 3 x 3 x 3.
    """
    group = _CUBE * _CUBES_PER_GROUP_EDGE
    counts = [
        group * max(1, round(float(side) / (group * _BACKGROUND_SPACING_M)))
        for side in volume.max_m - volume.min_m
    ]
    grid = Grid(
        *(low + _BACKGROUND_SPACING_M * np.arange(n) for low, n in zip(volume.min_m, counts, strict=True))
    )
    cubes = np.zeros([n // _CUBE for n in counts], dtype=bool)
    groups = np.stack(np.meshgrid(*(np.arange(n // group) for n in counts), indexing="ij"), axis=-1)
    within = rng.integers(0, _CUBES_PER_GROUP_EDGE, (groups.size // 3, 3))
    chosen = _CUBES_PER_GROUP_EDGE * groups.reshape(-1, 3) + within
    cubes[tuple(chosen.T)] = True
    where = cubes.repeat(_CUBE, 0).repeat(_CUBE, 1).repeat(_CUBE, 2)
    inside = [
        (axis >= own[0]) & (axis <= own[-1]) for axis, own in zip(_axes(grid), _axes(crop), strict=True)
    ]
    where &= ~(inside[0][:, None, None] & inside[1][:, None] & inside[2])
    # one block: a block's own cost is that of many cells
    image = focus(measurement, grid, normals=False, where=where, cells_per_edge=max(counts)).image
    magnitude = np.abs(image[where])
    per_sample = _CUBES_PER_GROUP_EDGE**3 * _BACKGROUND_SPACING_M**3 / float(np.prod(voxel_edges_m(crop)))
    return Background(magnitude, np.full(len(magnitude), per_sample))


def find_crop(
    measurement: Measurement, volume: Volume, progress: Callable[[int, int], None] | None = None
) -> Volume | None:
    """The box around everything that reflects, with margins; None if nothing does.

    It is looked for below the aperture: the side lobes of a raster coarser than half a wavelength look like objects, and
    those of 4 mm lie 0.17 m beside what reflects. An image at 6 mm is enough to see where the reflections lie.
    """
    antennas = measurement.aperture.tx_m
    low, high = volume.min_m.copy(), volume.max_m.copy()
    low[:2], high[:2] = antennas[:, :2].min(axis=0) - _BESIDE_M, antennas[:, :2].max(axis=0) + _BESIDE_M
    grid = Grid.box(low, high, _COARSE_SPACING_M)
    image = focus(measurement, grid, normals=False, progress=progress).image
    specular = specular_mask(image, grid)
    components = connected_components(specular.mask, grid, minimum_volume_m3=0.0, fallback_volume_m3=0.0)
    if not components:
        return None
    # specks far from the object must not widen the crop
    largest = len(components[0])
    kept = np.concatenate([component for component in components if len(component) >= 0.05 * largest])
    low, high = (
        np.array([axis[i] for axis, i in zip(_axes(grid), end, strict=True)])
        for end in (kept.min(axis=0), kept.max(axis=0))
    )
    return Volume(
        np.maximum(low - CROP_MARGIN_M, volume.min_m), np.minimum(high + CROP_MARGIN_M, volume.max_m)
    )


def crop_grid(crop: Volume, volume: Volume, spacing_m: float) -> Grid:
    """Voxels of a crop.

    Raises:
        RadarError: the crop lies outside the volume.
    """
    if not (crop.max_m > volume.min_m).all() or not (crop.min_m < volume.max_m).all():
        raise RadarError(
            f"the crop {crop.min_m.round(3).tolist()} .. {crop.max_m.round(3).tolist()} m misses the imaged volume "
            f"{volume.min_m.round(3).tolist()} .. {volume.max_m.round(3).tolist()} m: check the units and the frame"
        )
    return Grid.box(crop.min_m, crop.max_m, spacing_m)


def _axes(grid: Grid) -> tuple[NDArray[np.float64], ...]:
    return grid.x, grid.y, grid.z
