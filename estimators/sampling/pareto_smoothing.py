"""Pareto smoothed importance sampling (Vehtari, Simpson, Gelman, Yao and Gabry 2024).

The numbers are those of arviz-stats, which loads longer than draws are evaluated.
"""

import numpy as np
from scipy.special import logsumexp

from robotmodels.common.arrays import Array

_LEAST = 5
"""Weights in a tail to which a distribution is fitted."""

_ALIKE = 1e-12
"""Of the largest weight: less is rounding."""

_PRIOR, _PRIOR_DRAWS = 0.5, 10
"""Shape to which that of a tail is drawn, as by so many draws."""


def pareto_smoothed(log_weights: Array) -> tuple[Array, float]:
    """Return smoothed log weights (N,), which sum to one, and the shape k of their tail.

    The 3 sqrt(N) largest weights, at most a fifth, give way to quantiles of the generalized Pareto
    distribution that is fitted to them; none exceeds the largest.

    Parameters
    ----------
    log_weights : ndarray, (N,)
        Finite.

    Returns
    -------
    tuple of (ndarray, float)
        Weights as they are, and an infinite k, where there are less than 25 or the tail vanishes
        beside the largest one: no Pareto distribution fits it. k is zero where they are alike.
    """
    x = log_weights - log_weights.max()
    order = np.argsort(x, kind="stable")
    count = int(min(len(x) / 5, 3 * np.sqrt(len(x))))
    if count < _LEAST:
        return x - logsumexp(x), np.inf
    tail, cutoff = order[-count:], np.exp(x[order[-count - 1]])
    if cutoff >= 1 - _ALIKE:
        return x - logsumexp(x), 0.0
    shape, scale = _generalized_pareto(np.exp(x[tail]) - cutoff)
    with np.errstate(all="ignore"):
        below = -np.log1p(-(np.arange(count) + 0.5) / count)
        smoothed = np.log(cutoff + scale * (np.expm1(shape * below) / shape if shape else below))
    if not np.isfinite(smoothed).all():
        return x - logsumexp(x), np.inf
    x[tail] = np.minimum(smoothed, 0.0)
    return x - logsumexp(x), shape


def _generalized_pareto(excess: Array) -> tuple[float, float]:
    """Return shape and scale of ascending values (n,) above zero (Zhang and Stephens 2009)."""
    n = len(excess)
    grid = np.arange(1, 31 + int(np.sqrt(n))) - 0.5
    quartile = excess[int(n / 4 + 0.5) - 1]
    with np.errstate(all="ignore"):
        slopes = 1 / excess[-1] + (1 - np.sqrt(len(grid) / grid)) / (3 * quartile)
        shapes = np.log1p(-slopes[:, None] * excess).mean(axis=1)
        profile = n * (np.log(-slopes / shapes) - shapes - 1)
        likelihood = np.exp(profile - logsumexp(profile))
        slope = float(slopes @ likelihood / likelihood.sum())
        shape = float(np.log1p(-slope * excess).mean())
    return (n * shape + _PRIOR_DRAWS * _PRIOR) / (n + _PRIOR_DRAWS), -shape / slope
