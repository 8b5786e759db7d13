"""Intervals of one fit by every method there is, side by side."""

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.uncertainty.covariance import METHODS, covariance
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, nearest

INTERVAL_METHODS = ("recommended", *METHODS, "posterior", "profile")
# Of the posterior's draws: an interval's ends to about a twentieth of a standard deviation.
DRAWS, ESS = 4000, 1000.0


def intervals_of(
    fit: Fit,
    method: str,
    level: float,
    rng: np.random.Generator,
    *,
    noise: str = "known",
) -> tuple[Array, Array]:
    """Return standard deviations (p,) and intervals (p, 2) of ln theta.

    Parameters
    ----------
    fit : Fit
        Fit whose parameters.
    method : str
        "recommended", "theorem1", "scaled", "empirical", "posterior" or "profile".
    level : float
        Level of the intervals.
    rng : Generator
        Source of the posterior's draws.
    noise : str
        As in `sample_posterior`.

    Raises
    ------
    InvalidInput
        For an unknown method.
    NotIdentifiable
        If a covariance is asked for and the information is singular.
    """
    center = np.log(fit.parameters.values)
    if method == "recommended":
        scatter = fit.trust.scatter
        std = np.sqrt(scatter.variance)
        half = scatter.quantile(level) * std
        return std, np.stack([center - half, center + half], axis=-1)
    if method in METHODS:
        uncertainty = covariance(fit, method)
        std = uncertainty.std
        half = uncertainty.quantile(level) * std
        return std, np.stack([center - half, center + half], axis=-1)
    if method == "posterior":
        return _posterior(fit, level, rng, noise)
    if method == "profile":
        from estimators.uncertainty.profile import profile_likelihood

        profiles = profile_likelihood(fit, level=level, noise=noise)
        ends = np.log([[p.lower, p.upper] for p in profiles])
        return np.array([p.std for p in profiles]), ends
    raise InvalidInput(
        f"method {method!r} is none of {', '.join(INTERVAL_METHODS)}"
        f"{nearest(method, INTERVAL_METHODS)}"
    )


def _posterior(fit: Fit, level: float, rng: np.random.Generator, noise: str) -> tuple[Array, Array]:
    from estimators.uncertainty.importance import importance_sample

    sample = importance_sample(fit, rng=rng, draws=DRAWS, noise=noise)
    if sample.trusted and sample.ess >= ESS:
        return sample.uncertainty().std, np.log(sample.interval(level))
    from estimators.uncertainty.convergence import Target
    from estimators.uncertainty.posterior import sample_posterior

    walkers = max(2 * len(fit.parameters), 16)
    posterior = sample_posterior(fit, rng=rng, walkers=walkers, target=Target(ess=ESS), noise=noise)
    return posterior.uncertainty().std, np.log(posterior.interval(level))
