"""What a reconstruction shows about its own quality, without the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from waveformer.model.level_choice import residual_losses
from waveformer.model.phase_agreement import (
    block_agreement,
    neighbour_rows,
    pair_agreement,
    profile_correlation,
)
from waveformer.model.range_response import range_limits, range_responses
from waveformer.model.range_window import measured_profiles, object_window
from waveformer.model.selection import Selection
from waveformer.model.surfaces import SurfaceStack
from waveformer.model.voxels import voxel_edges_m
from waveformer.simulator.errors import RadarError
from waveformer.simulator.grid import Grid
from waveformer.simulator.measurement import Measurement

# Disjoint groups of antennas that vote for a level.
_GROUPS = 4
_FLOOR_OF_FLOOR_DB = -80.0
_LEAST_EXTENT_M = 1e-3
# Losses up to a tenth of the way from the chosen one to the median count as nearly as good.
_NEARLY = 0.1


class ConfidenceFeatures(NamedTuple):
    """Numbers that a confidence is made of; all finite.

    Attributes:
        misfit: loss per antenna at the chosen level, see `residual_losses`. A surface of the right shape at the right depth leaves
            little; noise, clutter and wrong shapes leave a rest that no level removes.
        contrast: (median - chosen) / median of the loss over the levels. Where the minimum hardly stands out
            another level would have done as well.
        level_spread: log(1 + rms distance, in levels, of what four disjoint groups of antennas would have chosen
            from the choice). Groups that disagree follow noise or clutter, not one surface.
        neighbour_agreement: steadiness of the residual phase between neighbouring antennas, the worse of x and
            y. An error of whole robot rows shows along one axis only and nowhere in the magnitudes.
        block_agreement: the same over blocks of 0.1 m. Wrong depth and curvature leave a phase that drifts.
        depth_agreement: block_agreement re its best over all levels. The loss goes by range, this by the curvature
            of the wavefront: where another level fits the phases better, range and curvature disagree about depth.
        image_floor_db: median of |S| outside the mask over its maximum. Noise fills it, and so do the side
            lobes of a sparse or irregular aperture.
        normal_roughness: mean angle between normals of touching voxels, degrees per millimetre. Noise makes
            the field ragged before it shows in the choice.
        column_ratio: the paper's |C_xy| / |C|, which finds sheets broken up by white noise.
        log_extent: log of the diagonal of the box around the chosen surface, metres. Errors count by the size of the
            object: what ruins a ball is nothing on a box.
        log_ambiguity: log of the depth over which levels fit nearly as well as the chosen one, re that diagonal.
    """

    misfit: float
    contrast: float
    level_spread: float
    neighbour_agreement: float
    block_agreement: float
    depth_agreement: float
    image_floor_db: float
    normal_roughness: float
    column_ratio: float
    log_extent: float
    log_ambiguity: float


def confidence_features(
    selection: Selection,
    stacks: Sequence[SurfaceStack],
    measurement: Measurement,
    grid: Grid,
    image: NDArray[np.complexfloating],
    normals: NDArray[np.floating],
    mask: NDArray[np.bool_],
    ratio: float,
) -> ConfidenceFeatures | None:
    """Features of one reconstruction.

    Args:
        selection: the choice.
        stacks: the surfaces it was made from.
        measurement: the scan.
        grid: voxels of the image.
        image: shape (X, Y, Z).
        normals: shape (X, Y, Z, 3), unit vectors inside the mask.
        mask: voxels taken as reflecting, shape (X, Y, Z).
        ratio: `uncertainty.column_ratio` of the chosen cloud; NaN counts as 1.

    Returns:
        None if nothing was chosen: there is no reconstruction to trust; nor if powers were compared, which have no phase.

    Raises:
        RadarError: the arrays do not fit the grid.
        SetupError: Mitsuba or its LLVM library is missing or broken.
    """
    if image.shape != grid.shape or mask.shape != grid.shape or normals.shape != (*grid.shape, 3):
        raise RadarError(
            f"image {image.shape}, mask {mask.shape} and normals {normals.shape} must fit the grid {grid.shape}"
        )
    if selection.is_empty or not selection.correlations:
        return None
    centers = 0.5 * (measurement.aperture.tx_m + measurement.aperture.receivers_m)
    neighbours, blocks = _phase_features(selection, stacks, measurement, centers)
    surface_m = _chosen_surface(selection, stacks).points_m
    sides_m = np.ptp(surface_m, axis=0) if len(surface_m) else np.zeros(3)
    extent_m = max(float(np.linalg.norm(sides_m)), _LEAST_EXTENT_M)
    return ConfidenceFeatures(
        *_loss_features(selection),
        neighbours,
        blocks,
        _depth_agreement(selection, centers[selection.rows]),
        image_floor_db(image, mask),
        normal_roughness(normals, mask, grid),
        1.0 if np.isnan(ratio) else float(ratio),
        float(np.log(extent_m)),
        float(np.log(_ambiguity_m(selection, measurement) / extent_m)),
    )


def image_floor_db(image: NDArray[np.complexfloating], mask: NDArray[np.bool_]) -> float:
    """Median of |S| outside the mask re the maximum of |S|, dB, -80 .. 0; 0 if the mask leaves nothing."""
    magnitude = np.abs(image)
    outside = magnitude[~mask]
    if len(outside) == 0 or not magnitude.max() > 0:
        return 0.0
    level = float(np.median(outside)) / float(magnitude.max())
    return max(_FLOOR_OF_FLOOR_DB, 20.0 * float(np.log10(max(level, 1e-30))))


def normal_roughness(normals: NDArray[np.floating], mask: NDArray[np.bool_], grid: Grid) -> float:
    """Mean angle between the normals of touching voxels of the mask, degrees per millimetre of their distance.

    Voxels without a normal (NaN) are left out; 0 if no two voxels touch.
    """
    usable = mask & np.isfinite(normals).all(axis=-1)
    total, count = 0.0, 0
    for axis, edge_m in enumerate(voxel_edges_m(grid).tolist()):
        lower, upper = (np.moveaxis(normals, axis, 0)[part] for part in (slice(-1), slice(1, None)))
        inside = np.moveaxis(usable, axis, 0)
        both = inside[:-1] & inside[1:]
        cosine = np.einsum("vi,vi->v", lower[both].astype(np.float64), upper[both].astype(np.float64))
        total += float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).sum()) / (1e3 * edge_m)
        count += len(cosine)
    return total / count if count else 0.0


def _loss_features(selection: Selection) -> tuple[float, float, float]:
    """Misfit, contrast and level spread, of the largest component that has a level."""
    component = _main_component(selection)
    losses, chosen = residual_losses(selection.correlations[component]), selection.level_index[component]
    curve = losses.mean(axis=1)
    middle = float(np.median(curve))
    contrast = (middle - float(curve[chosen])) / middle if middle > 0 else 0.0
    groups = np.array_split(np.arange(losses.shape[1]), min(_GROUPS, losses.shape[1]))
    votes = np.array([np.argmin(losses[:, group].sum(axis=1)) for group in groups])
    spread = float(np.log1p(np.sqrt(((votes - chosen) ** 2).mean())))
    return float(curve[chosen]), contrast, spread


def _ambiguity_m(selection: Selection, measurement: Measurement) -> float:
    """Depth of the levels of the main component that fit nearly as well as its choice; levels are half a wavelength apart."""
    component = _main_component(selection)
    curve = residual_losses(selection.correlations[component]).mean(axis=1)
    chosen = float(curve[selection.level_index[component]])
    nearly = curve <= chosen + _NEARLY * max(float(np.median(curve)) - chosen, 0.0)
    return max(int(nearly.sum()), 1) * float(measurement.chirp.wavelengths_m[0]) / 2.0


def _phase_features(
    selection: Selection,
    stacks: Sequence[SurfaceStack],
    measurement: Measurement,
    centers: NDArray[np.float64],
) -> tuple[float, float]:
    """Agreement of the residual phase between neighbours (the worse axis) and within blocks."""
    pairs = neighbour_rows(centers, selection.rows)
    rows = np.unique(np.concatenate([selection.rows, *(row for pair in pairs for row in pair)]))
    correlation = np.zeros(len(centers), dtype=np.complex128)
    correlation[rows] = profile_correlation(*_profiles(selection, stacks, measurement, rows))
    agreements = [pair_agreement(correlation[first], correlation[second]) for first, second in pairs]
    blocks = block_agreement(correlation[selection.rows], centers[selection.rows])
    return min(agreements, default=0.0), blocks


def _depth_agreement(selection: Selection, centers: NDArray[np.float64]) -> float:
    """Agreement within blocks at the chosen level re the best of all, 0 .. 1, of the largest component."""
    component = _main_component(selection)
    curve = np.array([block_agreement(values, centers) for values in selection.correlations[component]])
    return float(curve[selection.level_index[component]] / curve.max()) if curve.max() > 0 else 0.0


def _main_component(selection: Selection) -> int:
    """The first, and so the largest, component that has a level."""
    return next(i for i, level in enumerate(selection.level_index) if level >= 0)


def _profiles(
    selection: Selection, stacks: Sequence[SurfaceStack], measurement: Measurement, rows: NDArray[np.int64]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Measured and simulated profiles of the chosen surfaces, both (n, W)."""
    surface = _chosen_surface(selection, stacks)
    points = surface.points_m
    if len(points) == 0:
        nothing = np.zeros((len(rows), 1), dtype=np.complex64)
        return nothing, nothing
    aperture, chirp = measurement.aperture, measurement.chirp
    tx_m, rx_m = aperture.tx_m[rows], None if aperture.rx_m is None else aperture.rx_m[rows]
    window = object_window(chirp, *range_limits(points.min(axis=0), points.max(axis=0), tx_m, rx_m))
    simulated = range_responses(surface, 1, tx_m, rx_m, chirp, window)[0]
    return measured_profiles(measurement, rows, window), simulated


def _chosen_surface(selection: Selection, stacks: Sequence[SurfaceStack]) -> SurfaceStack:
    """The chosen surfaces of all components together, as one level."""
    parts = [
        (stack.points_m[at], stack.normals[at], stack.areas_m2[at])
        for stack, level in zip(stacks, selection.level_index, strict=True)
        if level >= 0 and (at := stack.level == level).any()
    ] or [(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))]
    points, normals, areas = (np.concatenate(values) for values in zip(*parts, strict=True))
    return SurfaceStack(points, normals, areas, np.zeros(len(points), dtype=np.int64))
