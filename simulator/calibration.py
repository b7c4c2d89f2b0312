"""A radar measured by a known object: range bias, gain, and how far each raster row was off in depth.

The phase of a whole row tells its depth to micrometres but only modulo half a wavelength; the envelope over the band
tells the bias without that ambiguity but coarsely. So the bias comes from the envelopes of all rows first, then
what the phases of all rows share refines it and what they do not share places the rows, then all is refined together
with the derivatives of the forward model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch.autograd import forward_ad

from waveformer.simulator.arguments import as_array, coordinates, instance, real_number, samples, shown
from waveformer.simulator.differentiable import freeze, simulate
from waveformer.simulator.errors import RadarError
from waveformer.simulator.radar import SPEED_OF_LIGHT_M_PER_S, Chirp

# Displacements in depth of all pairs (N,) -> echo of the object and its derivative by them, both (N, T).
DepthModel = Callable[[NDArray[np.float64]], tuple[NDArray[np.complex64], NDArray[np.complex64]]]

_ROUNDS = 4
# The envelope is searched this far, in steps of a tenth of what the band resolves.
_ENVELOPE_STEPS = 0.1
# Settings of the forward model that decide what is frozen.
_DISCRETE = ("sheets", "box", "antenna", "mode")


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
    h: ArrayLike,
    rows: ArrayLike,
    chirp: Chirp,
    model: DepthModel,
    *,
    row_deviation_m: float = 3e-4,
    largest_bias_m: float = 0.1,
) -> Calibration:
    """Range bias, gain and row depths from one scan.

    The mean of the rows and the bias differ only by how the ways incline, so the rows are taken to scatter about zero.

    Args:
        h: measured signal (N, T).
        rows: number of the raster row of every pair (N,), from `front_end_positions.raster_rows`.
        chirp: T samples.
        model: the known object seen from displaced antennas, such as `depth_model`.
        row_deviation_m: standard deviation of the rows that is expected, up to a twelfth of a wavelength: three of
            them are where the phase of a row gets ambiguous.
        largest_bias_m: the bias is searched up to here, either way.

    Raises:
        RadarError: shapes do not fit, numbers make no sense, rows are missing, or the signal is not that of the model.
    """
    instance("chirp", chirp, Chirp)
    row_of_pair = _checked_rows(rows)
    signal = samples("h", h, (len(row_of_pair), chirp.num_samples))
    deviation_m, reach_m = (
        real_number(name, value)
        for name, value in (("row_deviation_m", row_deviation_m), ("largest_bias_m", largest_bias_m))
    )
    wavelength_m = SPEED_OF_LIGHT_M_PER_S / chirp.center_hz
    if not 0.0 < deviation_m <= wavelength_m / 12.0:
        raise RadarError(
            f"row_deviation_m must lie in 0 .. {wavelength_m / 12.0:.3g} m, a twelfth of a wavelength, got "
            f"{deviation_m:g}: rows more than a quarter of a wavelength off look like others"
        )
    if not reach_m > 0.0:
        raise RadarError(f"largest_bias_m must be positive, got {reach_m:g}")
    count = int(row_of_pair.max()) + 1
    echo, slope = model(np.zeros(len(row_of_pair)))
    products = _row_products(signal, echo, row_of_pair, count)
    bias_m = _envelope_bias(products, chirp, reach_m)
    power = _row_products(echo, echo, row_of_pair, count).sum(axis=1).real
    if not power.all():
        raise RadarError(f"row {power.argmin()} does not see the known object: leave its pairs out")
    rate = _row_products(slope, echo, row_of_pair, count).sum(axis=1).imag / power
    bias_m, depths_m = _by_phase(products, rate, chirp, bias_m)
    for _ in range(_ROUNDS):
        at = _Linearised.of(signal, *model(depths_m[row_of_pair]), row_of_pair, chirp, bias_m)
        step = np.linalg.solve(*at.normal_equations(depths_m, deviation_m))
        bias_m, depths_m = bias_m + step[0], depths_m + step[2:]
    at = _Linearised.of(signal, *model(depths_m[row_of_pair]), row_of_pair, chirp, bias_m)
    normal, _ = at.normal_equations(depths_m, deviation_m)
    deviations = np.sqrt(at.noise * np.diag(np.linalg.inv(normal)))[[0, *range(2, 2 + count)]]
    return Calibration(float(bias_m), float(10.0 * np.log10(at.gain)), depths_m, at.misfit, deviations)


def depth_model(
    vertices: torch.Tensor | NDArray[np.float64],
    faces: NDArray[np.int64],
    chirp: Chirp,
    tx_m: NDArray[np.float64],
    rx_m: NDArray[np.float64] | None = None,
    **settings: Any,
) -> DepthModel:
    """A known object for `calibrate`: its echo and the derivative by a common rise of all antennas.

    Arguments as in `differentiable.simulate`. Gradients of tensors among them are left out.
    """
    discrete = {name: settings.pop(name) for name in _DISCRETE if name in settings}
    corners, transmitters = coordinates("vertices", vertices), coordinates("tx_m", tx_m)
    receivers = None if rx_m is None else coordinates("rx_m", rx_m)
    frozen = freeze(corners, faces, chirp, transmitters, receivers, **discrete)
    rise = torch.zeros((len(transmitters), 3), dtype=torch.float64)
    rise[:, 2] = 1.0

    def rising(side: NDArray[np.float64], depths_m: NDArray[np.float64]) -> torch.Tensor:
        places = torch.from_numpy(side + depths_m[:, None] * [0.0, 0.0, 1.0])
        dual: torch.Tensor = forward_ad.make_dual(places, rise)  # type: ignore[no-untyped-call]
        return dual

    def model(depths_m: NDArray[np.float64]) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
        with forward_ad.dual_level():
            tx = rising(transmitters, depths_m)
            rx = None if receivers is None else rising(receivers, depths_m)
            h = simulate(corners, faces, chirp, tx, rx, frozen=frozen, **discrete, **settings)
            both: Any = forward_ad.unpack_dual(h)  # type: ignore[no-untyped-call]
            return both.primal.detach().numpy(), both.tangent.detach().numpy()

    return model


def _turn(chirp: Chirp, path_m: float) -> NDArray[np.complex128]:
    """Phase of every sample over a path, shape (T,)."""
    return np.asarray(np.exp(-2j * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S * path_m))


def _checked_rows(rows: ArrayLike) -> NDArray[np.intp]:
    """Row numbers (N,), none of 0 .. R - 1 missing."""
    array = as_array(rows)
    if array is None or array.ndim != 1 or array.dtype.kind not in "iu" or len(array) == 0 or array.min() < 0:
        raise RadarError(f"rows must be whole numbers from 0, shape (N,), got {shown(rows)}")
    missing = np.setdiff1d(np.arange(array.max() + 1), array)
    if len(missing):
        raise RadarError(
            f"rows must number all rows from 0 to {array.max()}, but {len(missing)} of them, such as {missing[0]}, "
            "have no pair: number them anew"
        )
    return array.astype(np.intp)


def _row_products(
    h: NDArray[Any], echo: NDArray[Any], rows: NDArray[np.intp], count: int
) -> NDArray[np.complex128]:
    """Sum over the pairs of a row of h conj(echo), shape (R, T)."""
    products = np.zeros((count, h.shape[1]), dtype=np.complex128)
    np.add.at(products, rows, h * echo.conj())
    return products


def _envelope_bias(products: NDArray[np.complex128], chirp: Chirp, largest_m: float) -> float:
    """The bias at which the rows' correlations (R, T) over the band are largest, whatever their phase."""
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


def _by_phase(
    products: NDArray[np.complex128], rate: NDArray[np.float64], chirp: Chirp, bias_m: float
) -> tuple[float, NDArray[np.float64]]:
    """Bias and depths of the rows from the phases that the bias of the envelopes leaves.

    What all rows share belongs to the bias; the rest, within a quarter of a wavelength of zero, to the rows.

    Args:
        products: of signal and echo, by row, (R, T).
        rate: radians a metre of depth, from the model itself, (R,).
        chirp: T samples.
        bias_m: from the envelopes.
    """
    turns = np.exp(1j * np.angle(products @ _turn(chirp, bias_m).conj()))
    common = turns.sum()
    wavenumber = 2.0 * np.pi * chirp.center_hz / SPEED_OF_LIGHT_M_PER_S
    depths_m = np.angle(turns * common.conj()) / rate
    return bias_m - float(np.angle(common)) / wavenumber, depths_m


@dataclass(frozen=True, eq=False)
class _Linearised:
    """Residual and derivatives at present values, the gain the best real one in closed form."""

    residual: NDArray[np.complex128]
    by_bias: NDArray[np.complex128]
    by_log_gain: NDArray[np.complex128]
    by_depth: NDArray[np.complex128]
    rows: NDArray[np.intp]
    gain: float
    misfit: float

    @classmethod
    def of(
        cls,
        h: NDArray[Any],
        echo: NDArray[np.complex64],
        slope: NDArray[np.complex64],
        rows: NDArray[np.intp],
        chirp: Chirp,
        bias_m: float,
    ) -> _Linearised:
        turn = _turn(chirp, bias_m)
        bare = echo * turn
        gain = float((bare.conj() * h).real.sum() / (np.abs(bare) ** 2).sum())
        if not gain > 0.0:
            raise RadarError("h does not follow the model: is it a scan of this object, with these rows?")
        signal = gain * bare
        residual = h - signal
        by_bias = -2j * np.pi * chirp.frequencies_hz / SPEED_OF_LIGHT_M_PER_S * signal
        misfit = float((np.abs(residual) ** 2).sum() / (np.abs(h) ** 2).sum())
        return cls(residual, by_bias, signal, gain * slope * turn, rows, gain, misfit)

    @property
    def noise(self) -> float:
        """Variance of the real and of the imaginary part of the residual."""
        return float((np.abs(self.residual) ** 2).sum()) / (2 * self.residual.size)

    def normal_equations(
        self, depths_m: NDArray[np.float64], row_deviation_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """For bias, logarithm of the gain, and rows: rows do not mix, so sums by row do."""
        count = len(depths_m)
        normal, right = np.zeros((2 + count, 2 + count)), np.zeros(2 + count)
        common = (self.by_bias, self.by_log_gain)
        for i, one in enumerate(common):
            right[i] = self._inner(one, self.residual, count).sum()
            for j, other in enumerate(common):
                normal[i, j] = self._inner(one, other, count).sum()
            normal[i, 2:] = normal[2:, i] = self._inner(one, self.by_depth, count)
        precision = self.noise / row_deviation_m**2
        diagonal = range(2, 2 + count)
        normal[diagonal, diagonal] = self._inner(self.by_depth, self.by_depth, count) + precision
        right[2:] = self._inner(self.by_depth, self.residual, count) - precision * depths_m
        return normal, right

    def _inner(
        self, one: NDArray[np.complex128], other: NDArray[np.complex128], count: int
    ) -> NDArray[np.float64]:
        """Real inner product of every row, shape (R,)."""
        per_pair = (one.conj() * other).real.sum(axis=1)
        return np.bincount(self.rows, weights=per_pair, minlength=count).astype(np.float64)
