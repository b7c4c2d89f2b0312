"""What keeps a partial cloud from a radar off the true surface, without a signal.

The candidate that mmNorm chooses lies off the surface for five reasons, and each sample draws how much of each it has: rough
voxels (isotropic noise), a bent sheet (noise along the range, alike for neighbours), an image that noise floods (outliers),
a wrong range (one shift in depth), and a wrong level of the potential. A level is a surface at equal distance from the right
one, so a wrong one is not shifted but grown or shrunk: a ball becomes a ball of another radius.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from scipy.spatial import KDTree

from waveformer.datagen.truth_cloud import TruthCloud
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S

# Half of the wavelength at which mmNorm takes levels, at the start of MITO's chirp.
LEVEL_STEP_M = SPEED_OF_LIGHT_M_PER_S / 77.5001e9 / 2
# Outliers lie in the box that is imaged: the object's, and about as much air as `twin_scene.CROP_MARGIN_M`.
_AIR_M = 0.03
_WAVES = 128
_SMOOTHED_NORMALS = 12


def _ascending(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] > span[1]:
        raise ValueError(f"a range begins with its smaller value, got {span[0]:g} and {span[1]:g}")
    return span


Size = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Span = Annotated[tuple[Size, Size], AfterValidator(_ascending)]
ShareSpan = Annotated[tuple[Share, Share], AfterValidator(_ascending)]
CountSpan = Annotated[
    tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]], AfterValidator(_ascending)
]


class PartialNoise(BaseModel):
    """Ranges from which each sample draws its noise, uniformly unless said otherwise.

    Attributes:
        sigma_radii: rms displacement of a point, radii of the object's sphere; half of its square isotropic, half
            along the range.
        correlation_m: length over which the part along the range stays alike.
        outlier_share: points that lie anywhere in the imaged box instead.
        depth_shift_m: standard deviation (normal) of a shift of all points along the range.
        wrong_level_probability: that the cloud is another level of the potential.
        wrong_level_steps: how many steps of half a wavelength a wrong level is away, on either side.
        level_step_m: that half wavelength.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    sigma_radii: Span = (0.01, 0.05)
    correlation_m: Span = (0.002, 0.006)
    outlier_share: ShareSpan = (0.0, 0.02)
    depth_shift_m: Size = 0.002
    wrong_level_probability: Share = 0.15
    wrong_level_steps: CountSpan = (2, 10)
    level_step_m: Size = LEVEL_STEP_M


class NoisyCloud(NamedTuple):
    """A cloud after noise.

    Attributes:
        points_m: (P, 3).
        is_outlier: (P,).
        parameters: what was drawn, JSON values.
    """

    points_m: NDArray[np.float64]
    is_outlier: NDArray[np.bool_]
    parameters: dict[str, Any]


def add_noise(
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    truth: TruthCloud,
    viewpoint_m: NDArray[np.float64],
    noise: PartialNoise,
    rng: np.random.Generator,
) -> NoisyCloud:
    """Draw the noise of one sample and apply it.

    Args:
        points_m, normals: of the surface, (P, 3), P = 0 allowed.
        truth: of the whole object: its radius and its box.
        viewpoint_m: where the range is measured from, (3,).
        noise: ranges.
        rng: random numbers; the parameters are drawn first, always as many.
    """
    sigma_radii, correlation_m, outlier_share = (
        float(rng.uniform(*span)) for span in (noise.sigma_radii, noise.correlation_m, noise.outlier_share)
    )
    shift_m = float(noise.depth_shift_m * rng.standard_normal())
    is_wrong = rng.random() < noise.wrong_level_probability
    low, high = noise.wrong_level_steps
    steps = int(rng.integers(low, high + 1)) * (1 if rng.random() < 0.5 else -1)
    steps = steps if is_wrong else 0

    count = len(points_m)
    noisy = points_m
    if steps and count:
        noisy = points_m + steps * noise.level_step_m * smoothed_normals(points_m, normals)
    away = noisy - viewpoint_m
    away = away / np.linalg.norm(away, axis=1, keepdims=True)
    part_m = sigma_radii * truth.radius_m / np.sqrt(2)
    along_m = shift_m + part_m * correlated_field(points_m, correlation_m, rng)
    noisy = noisy + part_m / np.sqrt(3) * rng.standard_normal((count, 3)) + along_m[:, None] * away
    is_outlier = rng.random(count) < outlier_share
    lowest_m, highest_m = truth.points_m.min(axis=0) - _AIR_M, truth.points_m.max(axis=0) + _AIR_M
    anywhere_m = rng.uniform(lowest_m, highest_m, (count, 3))
    noisy = np.where(is_outlier[:, None], anywhere_m, noisy)
    parameters = {
        "sigma_radii": sigma_radii,
        "correlation_m": correlation_m,
        "outlier_share": outlier_share,
        "depth_shift_m": shift_m,
        "level_steps": steps,
    }
    return NoisyCloud(noisy, is_outlier, parameters)


def correlated_field(
    points_m: NDArray[np.float64], length_m: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Values of mean 0 and variance 1 whose covariance is exp(-d^2 / (2 length^2)) at distance d, shape (P,).

    A sum of cosine waves with normal wave vectors: Rahimi & Recht 2007, "Random features for large-scale kernel
    machines". Length 0 makes them independent.
    """
    if length_m == 0.0:
        return rng.standard_normal(len(points_m))
    waves = rng.standard_normal((3, _WAVES)) / length_m
    # Not by BLAS, whose sums depend on the number of threads.
    phases = np.einsum("pi,iw->pw", points_m, waves) + rng.uniform(0.0, 2 * np.pi, _WAVES)
    heights = np.sqrt(2 / _WAVES) * rng.standard_normal(_WAVES)
    return np.asarray(np.einsum("pw,w->p", np.cos(phases), heights))


def smoothed_normals(points_m: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit normals averaged over each point's neighbours, (P, 3): faces of a scan are rough, levels are not."""
    near = KDTree(points_m).query(points_m, k=min(_SMOOTHED_NORMALS, len(points_m)))[1]
    total = normals[near.reshape(len(points_m), -1)].sum(axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.where(length > 0, length, 1.0), normals)
