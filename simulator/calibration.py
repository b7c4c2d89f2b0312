"""A radar measured by a known object: range bias, gain, and how far each raster row was off in depth.

The phase of a whole row tells its depth to micrometres but only modulo half a wavelength; the envelope over the band
tells the bias without that ambiguity but coarsely. So the bias comes from the envelopes of all rows first, then rows
are placed within half a wavelength of it, then all is refined together with the derivatives of the forward model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.autograd import forward_ad

from waveformer.simulator.differentiable import freeze, simulate
from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

# Displacements in depth of all pairs (N,) -> echo of the object and its derivative by them, both (N, T).
DepthModel = Callable[[NDArray[np.float64]], tuple[NDArray[np.complex64], NDArray[np.complex64]]]

_ROUNDS = 4
# The envelope is searched this far, in steps of a tenth of what the band resolves.
_ENVELOPE_STEPS = 0.1


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a scan of a known object says about the radar.

    Attributes:
        range_bias_m: added to the round-trip path.
        antenna_gain_db: of each antenna, over the gain that was assumed.
        row_depth_m: height of every row over its nominal place, shape (R,).
        misfit: power of the residual over that of the signal.
        deviations_m: standard deviations of bias and rows if the residual is noise, shape (1 + R,).
    """

    range_bias_m: float
    antenna_gain_db: float
    row_depth_m: NDArray[np.float64]
    misfit: float
    deviations_m: NDArray[np.float64]


def calibrate(
    h: NDArray[np.complex64],
    rows: NDArray[np.intp],
    chirp: Chirp,
    model: DepthModel,
    *,
    row_deviation_m: float = 1e-3,
    largest_bias_m: float = 0.1,
) -> Calibration:
    """Range bias, gain and row depths from one scan.

    The mean of the rows and the bias differ only by how the ways incline, so the rows are taken to scatter about zero.

    Args:
        h: measured signal (N, T).
        rows: number of the raster row of every pair (N,), from `front_end_positions.raster_rows`.
        chirp: T samples.
        model: the known object seen from displaced antennas, such as `depth_model`.
        row_deviation_m: standard deviation of the rows that is expected.
        largest_bias_m: the bias is searched up to here, either way.

    Raises:
        RadarError: shapes do not fit.
    """
    if h.shape != (len(rows), chirp.num_samples):
        raise RadarError(
            f"h of shape {h.shape} does not fit {len(rows)} pairs and {chirp.num_samples} samples"
        )
    count = int(rows.max()) + 1
    echo, slope = model(np.zeros(len(rows)))
    bias = _envelope_bias(h, echo, rows, count, chirp, largest_bias_m)
    depths = _phase_depths(h, echo, slope, rows, count, chirp, bias)
    # the phase of all rows together belongs to the bias
    gain = 1.0
    for _ in range(_ROUNDS):
        echo, slope = model(depths[rows])
        bias, gain, depths, misfit, deviations = _refined(
            h, echo, slope, rows, chirp, bias, gain, depths, row_deviation_m
        )
    return Calibration(bias, float(10.0 * np.log10(gain)), depths, misfit, deviations)


def depth_model(
    vertices: torch.Tensor | NDArray[np.float64],
    faces: NDArray[np.int64],
    chirp: Chirp,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None = None,
    **settings: Any,
) -> DepthModel:
    """A known object for `calibrate`: its echo and the derivative by a common rise of all antennas.

    Arguments as in `differentiable.simulate`.
    """
    frozen = freeze(vertices, faces, chirp, tx_m, rx_m)
    rise = torch.zeros((len(tx_m), 3), dtype=torch.float64)
    rise[:, 2] = 1.0

    def model(depths_m: NDArray[np.float64]) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
        with forward_ad.dual_level():
            sides: list[Any] = [
                None
                if side is None
                else forward_ad.make_dual(  # type: ignore[no-untyped-call]
                    torch.from_numpy(side + depths_m[:, None] * [0.0, 0.0, 1.0]), rise
                )
                for side in (tx_m, rx_m)
            ]
            h = simulate(vertices, faces, chirp, sides[0], sides[1], frozen=frozen, **settings)
            both: Any = forward_ad.unpack_dual(h)  # type: ignore[no-untyped-call]
            return both.primal.numpy(), both.tangent.numpy()

    return model


def _turn(chirp: Chirp, path_m: float) -> NDArray[np.complex128]:
    """Phase of every sample over a path, shape (T,)."""
    return np.asarray(np.exp(-2j * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S * path_m))


def _row_products(
    h: NDArray[np.complex64], echo: NDArray[np.complex64], rows: NDArray[np.intp], count: int
) -> NDArray[np.complex128]:
    """Sum over the pairs of a row of h conj(echo), shape (R, T)."""
    products = np.zeros((count, h.shape[1]), dtype=np.complex128)
    np.add.at(products, rows, h * echo.conj())
    return products


def _envelope_bias(
    h: NDArray[np.complex64],
    echo: NDArray[np.complex64],
    rows: NDArray[np.intp],
    count: int,
    chirp: Chirp,
    largest_m: float,
) -> float:
    """The bias at which the rows' correlations over the band are largest, whatever their phase."""
    products = _row_products(h, echo, rows, count)
    step = _ENVELOPE_STEPS * SPEED_OF_LIGHT_M_PER_S / chirp.bandwidth_hz
    offsets = chirp.frequencies_hz - chirp.center_hz

    def power(paths: NDArray[np.float64]) -> NDArray[np.float64]:
        back = np.exp(2j * np.pi / SPEED_OF_LIGHT_M_PER_S * offsets[:, None] * paths)
        return np.asarray((np.abs(products @ back) ** 2).sum(axis=0))

    best = 0.0
    for reach in (largest_m, step, step / 10.0, step / 100.0):
        paths = best + np.linspace(-reach, reach, max(41, 2 * int(np.ceil(reach / step)) + 1))
        best = float(paths[power(paths).argmax()])
    return best


def _phase_depths(
    h: NDArray[np.complex64],
    echo: NDArray[np.complex64],
    slope: NDArray[np.complex64],
    rows: NDArray[np.intp],
    count: int,
    chirp: Chirp,
    bias_m: float,
) -> NDArray[np.float64]:
    """Depth of every row from the phase that is left after the bias, within a quarter of a wavelength of zero."""
    phase = np.angle(_row_products(h, echo, rows, count) @ _turn(chirp, bias_m).conj())
    # radians a metre of depth, from the model itself
    rate = (_row_products(slope, echo, rows, count).sum(axis=1)).imag
    rate /= _row_products(echo, echo, rows, count).sum(axis=1).real
    return np.asarray(phase / rate)


def _refined(
    h: NDArray[np.complex64],
    echo: NDArray[np.complex64],
    slope: NDArray[np.complex64],
    rows: NDArray[np.intp],
    chirp: Chirp,
    bias_m: float,
    gain: float,
    depths_m: NDArray[np.float64],
    row_deviation_m: float,
) -> tuple[float, float, NDArray[np.float64], float, NDArray[np.float64]]:
    """One Gauss-Newton step for bias, logarithm of the amplitude, and rows: rows do not mix, so sums by row do."""
    count = len(depths_m)
    turn = _turn(chirp, bias_m)
    bare = echo * turn
    # the best real gain in closed form
    gain = float((bare.conj() * h).real.sum() / (np.abs(bare) ** 2).sum())
    signal, by_depth = gain * bare, gain * slope * turn
    by_bias = -2j * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S * signal
    residual = h - signal
    misfit = float((np.abs(residual) ** 2).sum() / (np.abs(h) ** 2).sum())
    noise = float((np.abs(residual) ** 2).sum()) / (2 * residual.size)

    def inner(one: NDArray[np.complex128], other: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Real inner product of every row, shape (R,)."""
        per_pair = (one.conj() * other).real.sum(axis=1)
        return np.bincount(rows, weights=per_pair, minlength=count).astype(np.float64)

    normal = np.zeros((2 + count, 2 + count))
    right = np.zeros(2 + count)
    common = (by_bias, signal)
    for i, one in enumerate(common):
        right[i] = inner(one, residual).sum()
        for j, other in enumerate(common):
            normal[i, j] = inner(one, other).sum()
        normal[i, 2:] = normal[2:, i] = inner(one, by_depth)
    normal[range(2, 2 + count), range(2, 2 + count)] = inner(by_depth, by_depth) + noise / row_deviation_m**2
    right[2:] = inner(by_depth, residual) - noise / row_deviation_m**2 * depths_m
    step = np.linalg.solve(normal, right)
    deviations = np.sqrt(noise * np.diag(np.linalg.inv(normal)))
    return (
        bias_m + step[0],
        gain * float(np.exp(step[1])),
        depths_m + step[2:],
        misfit,
        deviations[[0, *range(2, 2 + count)]],
    )
