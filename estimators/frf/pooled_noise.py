"""Noise of a line from its neighbours: weights that do not follow the line's own scatter.

A variance from nu degrees of freedom scatters by 1/sqrt(nu) of itself. Weights that are its inverse
prefer lines whose errors happen to look small, which makes every covariance from them too small.
Variances of the neighbouring lines are independent of the line's own errors and scatter less.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robotmodels.common.arrays import Array, ComplexArray

_HALF_WIDTHS = (3, 2, 1)
_SHARE = 20  # of the lines, to either side, where that is more
_MANY_LINES = 100
_GAP_SHARE = 15  # at most a fifteenth of the lines is left out to either side
_FORGOTTEN = 0.1  # squared correlation at which lines count as independent
_ALIKE = 1e-6  # gains of rows and columns, as those of a single motor
_CLEAR = 10.0  # times the noise: gains below count as flat, so that errors weight no errors


@dataclass(frozen=True, eq=False)
class PooledNoise:
    """Variances of the lines as their neighbours tell them.

    Attributes
    ----------
    variance : ndarray, (Q, F, ...)
        Variance from neighbouring lines alone.
    line_share : ndarray, (Q, 1, ...)
        Share of the variance of the line itself, 0 to 1.
    mixed : ndarray, (Q, F, ...)
        Geometric means of the variance of the line, by its share, and that of the neighbours.
    lag_one : float
        Correlation of the errors of neighbouring lines.
    """

    variance: Array
    line_share: Array
    mixed: Array
    lag_one: float = 0.0


def pooled_noise(
    variances: Array,
    degrees_of_freedom: Array,
    deviations: ComplexArray | None = None,
    response: ComplexArray | None = None,
) -> PooledNoise:
    """Return variances of lines from those of their neighbours.

    The geometric mean over one to three lines, or a twentieth of all, to either side, whichever
    predicts the variances of an element best, times nu/exp(digamma(nu)), by which the logarithm of
    a variance with nu complex degrees of freedom is too small on average. Noise grows with the
    gains of the motor that moves (what a loop lets through) and of the output (what disturbs it),
    at resonances perhaps in a single line: powers of their norms, by least squares over the other
    lines, are part of the prediction where it is better so. Where variances still change from line
    to line, log s^2 less its prediction scatters by more than trigamma(nu), the variance of log s^2
    itself: the excess over the whole is the best share of the line's own one. One standard
    deviation of the estimated whole is given up, and a quarter of nu is the most, beyond which
    weights scatter too much.

    Neighbours whose errors are correlated say what the line itself says: there as many lines as
    possible are averaged, none has a share of its own, and of 100 lines and more the nearest are
    left out. Declared variances (nu infinite) are returned as they are.

    Parameters
    ----------
    variances : ndarray, (Q, F, ...)
        Estimated, positive.
    degrees_of_freedom : ndarray, (Q,)
        Complex ones of the variances.
    deviations : ndarray of complex, (Q, R, F, ...), optional
        Draws that the variances were made of; without them lines may be correlated.
    response : ndarray of complex, (Q, F, m, n), optional
        FRFs whose variances these are.
    """
    from scipy.special import digamma, polygamma

    lines = variances.shape[1]
    finite = np.isfinite(degrees_of_freedom)
    shape = (-1, *[1] * (variances.ndim - 1))
    none = np.zeros((len(variances), 1, *variances.shape[2:]))
    if lines < 2 or not finite.any():
        return PooledNoise(variances, none, variances)
    widest = max(_HALF_WIDTHS[0], lines // _SHARE)
    logs, gap, white, r = np.log(variances), 0, False, 0.0
    if deviations is not None:
        size = np.exp(_neighbour_mean(logs, widest, 0) / 2)[:, None]
        r = _lag_one(deviations / size)
        gap = _correlated_lines(r)
        white = not gap
    gap = min(gap, lines // _GAP_SHARE) if lines >= _MANY_LINES else 0
    widths = (widest, *_HALF_WIDTHS[1:]) if white else (widest,)
    mean, square = _best_prediction(logs, widths, gap, response)
    nu = np.where(finite, degrees_of_freedom, 1.0).reshape(shape)
    noise = polygamma(1, nu) * (1 + np.sqrt(2 / lines))
    share = np.clip(1 - noise / np.maximum(square, 1e-300), 0.0, np.minimum(nu / 4, 1.0))
    share = np.where(finite.reshape(shape), share, 0.0) if white else none
    bias = nu / np.exp(digamma(nu))
    declared = ~finite.reshape(shape)
    pooled = np.where(declared, variances, np.exp(mean) * bias)
    mixed = np.exp((1 - share) * mean + share * logs) * bias
    return PooledNoise(pooled, share, np.where(declared, variances, mixed), r)


def _best_prediction(
    logs: Array, widths: tuple[int, ...], gap: int, response: ComplexArray | None
) -> tuple[Array, Array]:
    """Return what predicts each element's log variances best, and its mean squared error."""
    predictions = [_neighbour_mean(logs, width, gap) for width in widths]
    if response is not None:
        gains = _log_gains(response, np.exp(_neighbour_mean(logs, widths[0], 0)))
        predictions += [_by_gains(logs, gains, width, gap) for width in widths]
    means = np.stack(predictions)
    squares = ((logs - means) ** 2).mean(axis=2, keepdims=True)
    best = squares.argmin(axis=0)[None]
    return (
        np.take_along_axis(means, best, axis=0)[0],
        np.take_along_axis(squares, best, axis=0)[0],
    )


def _log_gains(response: ComplexArray, noise: Array) -> Array:
    """Return logarithms of squared norms of columns and rows, (Q, F, m, n, 2), above the noise."""
    power = np.abs(response) ** 2 + _CLEAR * noise
    norms = np.stack(
        [np.broadcast_to(power.sum(axis=axis, keepdims=True), power.shape) for axis in (-2, -1)],
        axis=-1,
    )
    return np.asarray(np.log(norms))


def _by_gains(logs: Array, gains: Array, width: int, gap: int) -> Array:
    """Return neighbours' means, corrected by those powers of the gains that other lines show.

    Lines whose neighbours' mean knows the variance of the line itself are none of the others.
    """
    mean = _neighbour_mean(logs, width, gap)
    deviation = gains - _neighbour_mean(gains, width, gap)  # (Q, F, m, n, 2)
    index = np.arange(logs.shape[1])
    others = (np.abs(index[:, None] - index) > width + gap).astype(float)
    squares = _along_lines(others, deviation[..., :, None] * deviation[..., None, :])
    products = _along_lines(others, deviation * (logs - mean)[..., None])
    powers = np.linalg.pinv(squares, rcond=_ALIKE, hermitian=True) @ products[..., None]
    return np.asarray(mean + (deviation * powers[..., 0]).sum(axis=-1))


def _along_lines(weights: Array, values: Array) -> Array:
    """Return sums over lines (axis 1) with weights (F, F)."""
    return np.asarray(np.moveaxis(np.tensordot(weights, values, axes=(1, 1)), 0, 1))


def pooled_covariances(
    covariance: ComplexArray, pooled: Array, degrees_of_freedom: Array, lag_one: float = 0.0
) -> ComplexArray:
    """Return covariances (Q, F, k, k) with `pooled` variances (Q, F, k), regular from one draw on.

    Correlations between elements are the mean over the other lines of the position whose errors
    are not correlated with those of the line, shrunk towards none by k/(k + n), their number over
    that of the independent draws: `lag_one` r leaves (1 - r^2)/(1 + r^2) of each line's.
    """
    _, F, k = pooled.shape
    finite = np.isfinite(degrees_of_freedom)
    if F < 2 or not finite.any():
        return covariance
    root = np.sqrt(pooled)
    white = covariance / (root[..., :, None] * root[..., None, :])
    distance = np.abs(np.arange(F)[:, None] - np.arange(F))
    others = distance > _correlated_lines(lag_one)
    count = others.sum(axis=1)
    mean = np.einsum("fg,qgij->qfij", others / np.maximum(count, 1)[:, None], white)
    size = np.sqrt(np.diagonal(mean, axis1=-2, axis2=-1).real)
    size = np.where(count[:, None] > 0, size, 1.0)
    correlation = mean / (size[..., :, None] * size[..., None, :])
    nu = np.where(finite, degrees_of_freedom, 1.0)[:, None, None, None]
    draws = count[:, None, None] * nu * (1 - lag_one**2) / (1 + lag_one**2)
    shrinkage = k / (k + draws)
    correlation = (1 - shrinkage) * correlation + shrinkage * np.eye(k)
    result = correlation * root[..., :, None] * root[..., None, :]
    return np.asarray(np.where(finite[:, None, None, None], result, covariance))


def _neighbour_mean(values: Array, width: int, gap: int) -> Array:
    """Return the mean over neighbouring lines (axis 1), but for the nearest and the line itself."""
    index = np.arange(values.shape[1])
    distance = np.abs(index[:, None] - index)
    near = (distance <= width + gap) & (distance > gap)
    return _along_lines(near / near.sum(axis=1, keepdims=True), values)


def _lag_one(white: NDArray[Any]) -> float:
    """Return the size of the correlation of neighbouring lines' errors, 0 where none is seen."""
    products = float((np.conj(white[:, :, :-1]) * white[:, :, 1:]).real.sum())
    power = float((np.abs(white) ** 2).sum())
    r = abs(products) / power * white.shape[2] / (white.shape[2] - 1) if power > 0 else 0.0
    return min(r, 0.999) if r * np.sqrt(2 * white.size) >= 5 else 0.0


def _correlated_lines(lag_one: float) -> int:
    """Return how many lines to either side share errors with a line."""
    return int(np.ceil(np.log(_FORGOTTEN) / np.log(lag_one**2))) if lag_one else 0
