"""How well chains mix: R-hat and effective sample size, rank-normalised (Vehtari et al. 2021).

The numbers are those of arviz-stats, which loads longer than a small study's chains are sampled.
"""

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import ndtri

from robotmodels.common.arrays import Array


def rank_r_hat(series: Array) -> float:
    """Return R-hat of `series` (chains, draws), split in halves: the larger of bulk and tails."""
    halves = _halves(series)
    folded = np.abs(halves - np.median(halves))
    return max(_r_hat(_normal_scores(halves)), _r_hat(_normal_scores(folded)))


def bulk_size(series: Array) -> float:
    """Return the bulk effective sample size of `series` (chains, draws), split in halves.

    Autocorrelations are summed in pairs of lags over Geyer's initial monotone sequence (1992): as
    long as pairs are positive, none larger than the one before. The size is at most N log10 N.
    """
    scores = _normal_scores(_halves(series))
    n_draws, size = scores.shape[1], scores.size
    if np.ptp(scores) < np.finfo(float).resolution:
        return float(size)
    covariances = _autocovariances(scores)
    within = covariances[0] * n_draws / (n_draws - 1.0)
    total = within * (n_draws - 1.0) / n_draws + np.var(scores.mean(axis=1), ddof=1)
    rho = 1.0 - (within - covariances) / total
    rho[0] = 1.0
    end = 0
    while end < n_draws - 4 and rho[end] + rho[end + 1] > 0:
        end += 2
    for i in range(2, end - 1, 2):
        before = rho[i - 2] + rho[i - 1]
        if rho[i] + rho[i + 1] > before:
            rho[i : i + 2] = before / 2
    last = rho[end] if rho[end] > 0 or rho[end] + rho[end + 1] >= 0 else 0.0
    return float(size / max(-1.0 + 2.0 * rho[:end].sum() + last, 1 / np.log10(size)))


def _halves(series: Array) -> Array:
    half = series.shape[1] // 2
    return np.vstack([series[:, :half], series[:, -half:]])


def _normal_scores(series: Array) -> Array:
    """Return normal quantiles of the ranks of all values, equal ones at their mean rank (Blom)."""
    _, which, counts = np.unique(series.ravel(), return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[which]
    return np.asarray(ndtri((ranks - 3 / 8) / (series.size + 1 / 4)).reshape(series.shape))


def _r_hat(series: Array) -> float:
    draws = series.shape[1]
    between = draws * np.var(series.mean(axis=1), ddof=1)
    within = np.var(series, axis=1, ddof=1).mean()
    return float(np.sqrt((between / within + draws - 1) / draws))


def _autocovariances(series: Array) -> Array:
    """Return autocovariances (draws,) by lag, the mean over series (chains, draws)."""
    n = series.shape[1]
    padded = next_fast_len(2 * n, real=True)
    spectrum = np.fft.rfft(series - series.mean(axis=1, keepdims=True), n=padded)
    products = np.fft.irfft(spectrum * np.conjugate(spectrum), n=padded)[:, :n] / n
    return np.asarray(np.ascontiguousarray(products.T).mean(axis=1))
