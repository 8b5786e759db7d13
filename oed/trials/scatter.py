"""How well the scatter of N normal estimates is known: by chi square and by Wishart draws."""

import numpy as np

from estimators.uncertainty.monte_carlo import MonteCarlo
from oed.design.objective import Objective
from robotmodels.arrays import Array, BoolArray

DRAWS = 400
"""Of a Wishart distribution: quantiles of 95 % to a tenth of the interval's width."""


def std_interval(std: Array, samples: int, level: float) -> Array:
    """Return where true standard deviations lie, (p, 2), given those of so many samples, (p,)."""
    from scipy.stats import chi2

    tails = np.array([(1 + level) / 2, (1 - level) / 2])
    factors = np.sqrt((samples - 1) / chi2.ppf(tails, samples - 1))
    return np.asarray(std[:, None] * factors)


def clearly_smaller(one: MonteCarlo, other: MonteCarlo, level: float) -> BoolArray:
    """Return which standard deviations of one are below the other's by more than chance, (p,).

    By the F test of two variances; chance finds one as clear in a share 1 - `level` of cases.
    """
    from scipy.stats import f

    samples = len(one.estimates) - 1, len(other.estimates) - 1
    ratio = (one.uncertainty().std / other.uncertainty().std) ** 2
    return np.asarray(ratio < f.ppf(1 - level, *samples))


def ratio_interval(
    objective: Objective, one: MonteCarlo, other: MonteCarlo, level: float
) -> tuple[float, float, float]:
    """Return the efficiency of one scatter against another, and the ends of its interval.

    Efficiencies are the criterion's, of the inverse sample covariances. Their errors are those of
    draws from Wishart distributions about the samples (a parametric bootstrap; for D exact), whose
    median is taken away.
    """
    rng = np.random.default_rng(0)  # of the method, not of the experiments
    errors = _errors(objective, one, rng) - _errors(objective, other, rng)
    values = [_log_value(objective, mc.uncertainty().covariance) for mc in (one, other)]
    apart = values[0] - values[1]
    low, middle, high = np.quantile(errors, [(1 - level) / 2, 0.5, (1 + level) / 2])
    value, lower, upper = np.exp([apart - middle, apart - high, apart - low])
    return float(value), float(lower), float(upper)


def _log_value(objective: Objective, covariance: Array) -> float:
    return objective.log_value(np.asarray(np.linalg.inv(covariance)))


def _errors(objective: Objective, found: MonteCarlo, rng: np.random.Generator) -> Array:
    """Return what sampling adds to the log value, (DRAWS,)."""
    covariance, n = found.uncertainty().covariance, len(found.estimates)
    p = len(covariance)
    # Bartlett's decomposition of Wishart matrices of n - 1 degrees of freedom.
    triangles = np.tril(rng.standard_normal((DRAWS, p, p)), -1)
    triangles[:, np.arange(p), np.arange(p)] = np.sqrt(
        rng.chisquare(n - 1 - np.arange(p), (DRAWS, p))
    )
    roots = np.linalg.cholesky(covariance) @ triangles / np.sqrt(n - 1)
    informations = np.linalg.inv(roots @ np.swapaxes(roots, -1, -2))
    values = np.array([objective.log_value(one) for one in informations])
    return np.asarray(values - _log_value(objective, covariance))
