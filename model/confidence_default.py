"""The confidence that comes with the package: chance that more than 60 % of a surface's points lie within 0.08 radii.

Fitted by `benchmarks/surfaces/confidence.py` to 48 objects, clean and with seven kinds of failure, see docs/surfaces.md. On
objects left out of the fit the area under the curve is 0.93 and 0.86 (two halves, mean over the kinds).
"""

from __future__ import annotations

from waveformer.model.confidence import Confidence

# weight, mean and scale of every feature, in the order of `ConfidenceFeatures`
_COEFFICIENTS = (
    (0.2826, 0.6799, 0.5499),  # misfit
    (0.2157, 0.5422, 0.2855),  # contrast
    (-0.626, 1.194, 0.9075),  # level_spread
    (0.8455, 0.439, 0.3278),  # neighbour_agreement
    (0.03642, 0.4926, 0.2939),  # block_agreement
    (0.1747, 0.8192, 0.1786),  # depth_agreement
    (-0.3392, -30.73, 7.279),  # image_floor_db
    (-0.2235, 1.989, 0.9025),  # normal_roughness
    (-0.284, 0.527, 0.04837),  # column_ratio
    (0.1406, -1.741, 0.5598),  # log_extent
    (-0.359, -2.784, 0.9498),  # log_ambiguity
)
_WEIGHTS, _MEANS, _SCALES = zip(*_COEFFICIENTS, strict=True)

DEFAULT_CONFIDENCE = Confidence(-0.3238, _WEIGHTS, _MEANS, _SCALES)
