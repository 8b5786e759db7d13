"""Noise of a line from its neighbours: weights that do not follow the line's own scatter.

A variance from nu degrees of freedom scatters by 1/sqrt(nu) of itself. Weights that are its inverse
prefer lines whose errors happen to look small, which makes every covariance from them too small.
Variances of the neighbouring lines are independent of the line's own errors and scatter less.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.arrays import Array, ComplexArray

_HALF_WIDTH = 3
_PRECISE = 10  # degrees of freedom from which on two lines to either side suffice
_SHARE = 20  # of the lines, to either side, where that is more
_MANY_LINES = 100
_LEFT_OUT = 15  # at most a fifteenth of the lines is left out to either side
_FORGOTTEN = 0.1  # squared correlation at which lines count as independent


def pooled_variances(
    variances: Array, degrees_of_freedom: Array, deviations: ComplexArray | None = None
) -> Array:
    """Return variances (Q, F, ...) from those of neighbouring lines, the line itself left out.

    The geometric mean over two or three lines, or a twentieth of all, to either side, times
    nu/exp(digamma(nu)), by which the logarithm of a variance with nu complex degrees of freedom is
    too small on average. Declared variances (nu infinite) are returned as they are. Of 100 lines
    and more those next to the line are left out as well, as far as deviations are correlated.

    Parameters
    ----------
    variances : (Q, F, ...)
        Estimated, positive.
    degrees_of_freedom : (Q,)
        Complex ones of the variances.
    deviations : (Q, R, F, ...), optional
        Draws that the variances were made of.
    """
    from scipy.special import digamma

    lines = variances.shape[1]
    finite = np.isfinite(degrees_of_freedom)
    if lines < 2 or not finite.any():
        return variances
    few = bool((degrees_of_freedom[finite] < _PRECISE).any())
    width = max(_HALF_WIDTH if few else _HALF_WIDTH - 1, lines // _SHARE)
    pooled = _neighbour_mean(np.log(variances), width, 0)
    if deviations is not None and lines >= _MANY_LINES:
        white = deviations / np.exp(pooled / 2)[:, None]
        left_out = _correlated_lines(white)
        if left_out:
            pooled = _neighbour_mean(np.log(variances), width, left_out)
    nu = np.where(finite, degrees_of_freedom, 1.0)
    factor = (nu / np.exp(digamma(nu))).reshape(-1, *[1] * (variances.ndim - 1))
    result = np.exp(pooled) * factor
    return np.where(finite.reshape(factor.shape), result, variances)


def pooled_covariances(
    covariance: ComplexArray, pooled: Array, degrees_of_freedom: Array
) -> ComplexArray:
    """Return covariances (Q, F, k, k) with `pooled` variances (Q, F, k), regular from one draw on.

    Correlations between elements are the mean over the other lines of the position, shrunk towards
    none by k/(k + (F - 1) nu), their number over that of the draws.
    """
    _, F, k = pooled.shape
    finite = np.isfinite(degrees_of_freedom)
    if F < 2 or not finite.any():
        return covariance
    root = np.sqrt(pooled)
    white = covariance / (root[..., :, None] * root[..., None, :])
    mean = (white.sum(axis=1, keepdims=True) - white) / (F - 1)
    size = np.sqrt(np.diagonal(mean, axis1=-2, axis2=-1).real)
    correlation = mean / (size[..., :, None] * size[..., None, :])
    nu = np.where(finite, degrees_of_freedom, 1.0)[:, None, None, None]
    shrinkage = k / (k + (F - 1) * nu)
    correlation = (1 - shrinkage) * correlation + shrinkage * np.eye(k)
    result = correlation * root[..., :, None] * root[..., None, :]
    return np.asarray(np.where(finite[:, None, None, None], result, covariance))


def _neighbour_mean(values: Array, width: int, left_out: int) -> Array:
    """Return the mean over neighbouring lines (axis 1), but for the nearest and the line itself."""
    index = np.arange(values.shape[1])
    apart = np.abs(index[:, None] - index)
    near = (apart <= width + left_out) & (apart > left_out)
    share = near / near.sum(axis=1, keepdims=True)
    return np.asarray(np.moveaxis(np.tensordot(share, values, axes=(1, 1)), 0, 1))


def _correlated_lines(white: NDArray[Any]) -> int:
    """Return how many lines to either side share errors with a line, by the lag-one correlation."""
    lag_one = float((np.conj(white[:, :, :-1]) * white[:, :, 1:]).real.sum())
    power = float((np.abs(white) ** 2).sum())
    r = abs(lag_one) / power * white.shape[2] / (white.shape[2] - 1) if power > 0 else 0.0
    if r * np.sqrt(2 * white.size) < 5:
        return 0
    lines = np.log(_FORGOTTEN) / np.log(min(r, 0.999) ** 2)
    return int(min(np.ceil(lines), white.shape[2] // _LEFT_OUT))
