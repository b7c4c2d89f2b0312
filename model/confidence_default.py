"""The confidence that comes with the package: chance that more than 60 % of a surface's points lie within 0.08 radii.

Fitted by `benchmarks/surfaces/confidence.py` to 48 objects, clean and with seven kinds of failure, see docs/surfaces.md. On
objects left out of the fit the area under the curve is 0.87 and 0.91 (two halves, mean over the kinds).
"""

from __future__ import annotations

from waveformer.model.confidence import Confidence

# weight, mean and scale of every feature, in the order of `ConfidenceFeatures`
_COEFFICIENTS = (
    (0.1899, 0.6595, 0.2072),  # misfit
    (-0.02188, 0.2875, 0.2116),  # contrast
    (-0.6132, 1.083, 0.9098),  # level_spread
    (0.975, 0.4532, 0.3318),  # neighbour_agreement
    (0.08342, 0.5032, 0.2935),  # block_agreement
    (0.3514, 0.8413, 0.1696),  # depth_agreement
    (0.02309, -30.74, 7.269),  # image_floor_db
    (-0.1588, 1.987, 0.9019),  # normal_roughness
    (-0.1427, 0.5275, 0.04736),  # column_ratio
    (0.01571, -1.734, 0.4853),  # log_extent
    (-0.3181, -3.049, 0.9988),  # log_ambiguity
)
_WEIGHTS, _MEANS, _SCALES = zip(*_COEFFICIENTS, strict=True)

DEFAULT_CONFIDENCE = Confidence(0.2019, _WEIGHTS, _MEANS, _SCALES)
