"""Intervals of one fit by every method there is, side by side."""

from statistics import NormalDist

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.uncertainty.covariance import METHODS, covariance
from robotmodels.arrays import Array
from robotmodels.errors import InvalidInput, nearest

INTERVAL_METHODS = (*METHODS, "posterior", "profile")
# Of the posterior's draws: an interval's ends to about a twentieth of a standard deviation.
DRAWS, ESS = 4000, 1000.0


def intervals_of(
    fit: Fit,
    method: str,
    level: float,
    rng: np.random.Generator,
    *,
    noise: str = "known",
    blocks: int | None = None,
) -> tuple[Array, Array]:
    """Return standard deviations (p,) and intervals (p, 2) of ln theta.

    Parameters
    ----------
    fit : whose parameters.
    method : "theorem1", "scaled", "empirical", "posterior" or "profile".
    level : of the intervals.
    rng : source of the posterior's draws.
    noise, blocks : as in `sample_posterior`; estimated noise of so many blocks widens Theorem 1 as
        well, see `covariance`.

    Raises
    ------
    InvalidInput : for an unknown method.
    NotIdentifiable : if a covariance is asked for and the information is singular.
    """
    if method in METHODS:
        counted = blocks if noise == "estimated" and method != "empirical" else None
        std = covariance(fit, method, blocks=counted).std
        half = NormalDist().inv_cdf((1 + level) / 2) * std
        center = np.log(fit.parameters.values)
        return std, np.stack([center - half, center + half], axis=-1)
    if method == "posterior":
        return _posterior(fit, level, rng, noise, blocks)
    if method == "profile":
        from estimators.uncertainty.profile import profile_likelihood

        profiles = profile_likelihood(fit, level=level, noise=noise, blocks=blocks)
        ends = np.log([[p.lower, p.upper] for p in profiles])
        return np.array([p.std for p in profiles]), ends
    raise InvalidInput(
        f"method {method!r} is none of {', '.join(INTERVAL_METHODS)}"
        f"{nearest(method, INTERVAL_METHODS)}"
    )


def _posterior(
    fit: Fit, level: float, rng: np.random.Generator, noise: str, blocks: int | None
) -> tuple[Array, Array]:
    from estimators.uncertainty.importance import importance_sample

    sample = importance_sample(fit, rng=rng, draws=DRAWS, noise=noise, blocks=blocks)
    if sample.trusted and sample.ess >= ESS:
        return sample.uncertainty().std, np.log(sample.interval(level))
    from estimators.uncertainty.convergence import Target
    from estimators.uncertainty.posterior import sample_posterior

    walkers = max(2 * len(fit.parameters), 16)
    posterior = sample_posterior(
        fit, rng=rng, walkers=walkers, target=Target(ess=ESS), noise=noise, blocks=blocks
    )
    return posterior.uncertainty().std, np.log(posterior.interval(level))
