"""Factor and lag between two channels: one regressed on the other, or on its integral, shifted.

The model is ``target(t) = a + b t + factor * basis(t + lag)``, with the basis a cubic spline
through the real stamps: of an angle, where b is zero, or of the integral of a velocity. Cross
spectra in windows are biased on records that are not periodic; this is not.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from estimators.logs.correlated_regression import Series, regress
from robotmodels.common.arrays import Array

MOST_UNEXPLAINED = 0.01
"""Of the target's variation, as rms over rms, up to which a relation counts."""
_MOST_LAG = 0.5  # [s]
_LAGS = 161
_COARSE = 3000  # samples that the coarse search takes
_ITERATIONS = 12
_BLOCK_TIME = 0.1  # [s] of a mean that standard errors come from
_SHOWN = 0.9  # of the velocity's variation that means must show
_MOST_BLOCKS = 1500


@dataclass(frozen=True)
class Relation:
    """A channel explained by another.

    Attributes
    ----------
    factor : float
        Target over basis.
    lag, lag_std : float, s
        By which the basis channel is late.
    unexplained : float
        Residual over the variation of the target, rms over rms.
    """

    factor: float
    lag: float
    lag_std: float
    unexplained: float

    @property
    def determined(self) -> bool:
        """Whether the basis explains the target well enough."""
        return self.unexplained < MOST_UNEXPLAINED


def velocity_relation(times: Array, angle: Array, velocity: Array) -> Relation | None:
    """Return how an angle follows from the integral of a velocity, None where nothing moves.

    Parameters
    ----------
    times : ndarray, (N,), s
        Stamps, rising.
    angle, velocity : ndarray, (N,)
        In any units.
    """
    return _relation(times, angle, velocity, integrate=True)


def angle_relation(times: Array, target: Array, angle: Array) -> Relation | None:
    """Return how an angle follows from another angle, None where nothing moves."""
    return _relation(times, target, angle, integrate=False)


def _relation(times: Array, target: Array, channel: Array, integrate: bool) -> Relation | None:
    good = np.isfinite(times) & np.isfinite(target) & np.isfinite(channel)
    t, y, x = times[good], target[good], channel[good]
    if len(t) < 16 or not np.ptp(y) > 0 or not np.ptp(x) > 0:
        return None
    t = t - t.mean()
    spline = CubicSpline(t, x)
    basis = spline.antiderivative() if integrate else spline
    most = min(_MOST_LAG, 0.1 * np.ptp(t))
    inside = (t >= t[0] + most) & (t <= t[-1] - most)
    t, y = t[inside], y[inside]
    # An offset of a velocity becomes a drift of its integral; angles have an offset only.
    trend = np.column_stack([np.ones_like(t), *([t] if integrate else [])])
    stride = max(1, len(t) // _COARSE)
    lags = np.linspace(-most, most, _LAGS)
    costs = [_linear(trend[::stride], y[::stride], basis(t[::stride] + lag))[1] for lag in lags]
    lag = _refined(t, y, trend, basis, float(lags[int(np.argmin(costs))]), lags[1] - lags[0])
    return _result(t, trend, y, basis(t + lag), basis(t + lag, 1), lag)


def _refined(t: Array, y: Array, trend: Array, basis: Any, lag: float, step: float) -> float:
    """Return the lag after Gauss-Newton steps, each at most one of the coarse search."""
    start = lag
    for _ in range(_ITERATIONS):
        (factor, *_), _, residual = _linear(trend, y, basis(t + lag))
        slope = factor * basis(t + lag, 1)
        change = _slope_fit(trend, basis(t + lag), slope, residual)
        lag = float(np.clip(lag + change, start - step, start + step))
        if abs(change) < 1e-10:
            break
    return lag


def _linear(trend: Array, y: Array, x: Array) -> tuple[Array, float, Array]:
    design = np.column_stack([x - x.mean(), trend])
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    residual = y - design @ solution
    return solution, float(residual @ residual), residual


def _slope_fit(trend: Array, x: Array, slope: Array, residual: Array) -> float:
    """Return the change of the lag that explains most of the residual, the rest refitted."""
    design = np.column_stack([slope, x - x.mean(), trend])
    return float(np.linalg.lstsq(design, residual, rcond=None)[0][0])


def _result(
    t: Array, trend: Array, y: Array, x: Array, slope: Array, lag: float
) -> Relation | None:
    solution, cost, _ = _linear(trend, y, x)
    factor = float(solution[0])
    if factor == 0:
        return None
    shared = np.column_stack([x - x.mean(), factor * slope])
    everything = np.ones(len(y), dtype=bool)
    fit = regress([Series(y, shared, trend, everything, _block(t, slope))])
    variation = y - y.mean()
    return Relation(
        factor=factor,
        lag=lag,
        lag_std=fit.std(1),
        unexplained=float(np.sqrt(cost / (variation @ variation))),
    )


def _block(t: Array, slope: Array) -> int:
    """Return the samples in a mean: a tenth of a second, fewer where means would hide movement."""
    block = max(1, round(_BLOCK_TIME / float(np.median(np.diff(t)))))
    while block > 1:
        whole = slope[: len(slope) // block * block].reshape(-1, block)
        if len(whole) and whole.mean(axis=1).std() > _SHOWN * slope.std():
            break
        block //= 2
    return max(block, len(slope) // _MOST_BLOCKS)
