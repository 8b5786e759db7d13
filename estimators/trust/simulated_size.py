"""The size of residuals where errors are correlated along the lines: judged by draws."""

import numpy as np

from estimators.frf.pooled_noise import pooled_variances
from estimators.trust.line_correlation import LineCorrelation, element_correlation
from estimators.trust.linearised_fit import LinearisedFit

_DRAWS = 200
_LEAST_FACTOR = 1.15
"""Ratios below this are not called too large, however improbable: the law of draws is rough."""


def simulated_probability(fit: LinearisedFit, correlation: LineCorrelation, ratio: float) -> float:
    """Return the probability of a ratio of totals as large, of noise with this correlation.

    The logarithm of the ratio of whitened totals, weights made from neighbouring lines as those of
    the fit, is normal with the mean and standard deviation of draws. Elements that are correlated
    count as fewer independent ones.
    """
    from scipy.special import ndtr

    if not ratio > _LEAST_FACTOR:
        return 1.0
    Q, F, k = fit.residuals.shape
    nu = np.where(np.isfinite(fit.degrees_of_freedom), fit.degrees_of_freedom, 1e3)
    draws = int(min(nu.min(), 40))
    elements = max(1, round(k / element_correlation(fit)))
    rng = np.random.default_rng(0)
    lag = np.abs(np.arange(F)[:, None] - np.arange(F))
    values, vectors = np.linalg.eigh(correlation.coefficients[lag])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    logs = np.empty(_DRAWS)
    for i in range(_DRAWS):
        shape = (2, Q, draws + 1, F, elements)
        parts = rng.standard_normal(shape) / np.sqrt(2)
        noise = root @ (parts[0] + 1j * parts[1])
        error, deviations = noise[:, 0], noise[:, 1:] / np.sqrt(draws)
        s2 = (np.abs(deviations) ** 2).sum(axis=1)
        w = 1 / pooled_variances(s2, np.full(Q, float(draws)), deviations)
        logs[i] = np.log((w * np.abs(error) ** 2).sum() / (w * s2).sum())
    return float(ndtr((logs.mean() - np.log(ratio)) / logs.std(ddof=1)))
