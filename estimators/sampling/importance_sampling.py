"""Importance sampling of a posterior: a cheap second opinion that says whether to believe it."""

from dataclasses import dataclass

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.priors import Prior
from estimators.sampling.log_posterior import posterior_density
from estimators.sampling.pareto_smoothing import pareto_smoothed
from estimators.sampling.student_t_proposal import DOF, laplace
from estimators.uncertainty.covariance import Uncertainty
from robotmodels.common.arrays import Array, check_level, read_only
from robotmodels.common.errors import InvalidInput, SolverFailed
from robotmodels.common.printing import ReprHtml
from robotmodels.common.progress import Progress

# Draws evaluated between two reports of progress.
BATCH = 2000


@dataclass(frozen=True, eq=False)
class ImportanceSample(ReprHtml):
    """Weighted draws of ln theta.

    Attributes
    ----------
    names : tuple of str
        p parameters.
    draws : ndarray, (N, p)
        Draws of ln theta from the proposal.
    log_weights : ndarray, (N,)
        Pareto smoothed; their exponentials sum to one.
    pareto_k : float
        Shape of the weights' tail, see `limit`.
    ess : float
        Effective number of draws, 1 / sum of squared weights.
    """

    names: tuple[str, ...]
    draws: Array
    log_weights: Array
    pareto_k: float
    ess: float

    @property
    def limit(self) -> float:
        """Largest Pareto k for which N draws do, min(1 - 1/log10 N, 0.7): Vehtari et al. 2024."""
        return float(min(1 - 1 / np.log10(len(self.draws)), 0.7))

    @property
    def trusted(self) -> bool:
        """Whether the proposal covers the posterior."""
        return self.pareto_k <= self.limit

    @property
    def weights(self) -> Array:
        """The weights (N,), which sum to one."""
        return np.asarray(np.exp(self.log_weights))

    @property
    def mean(self) -> Array:
        """Mean of ln theta, (p,)."""
        return np.asarray(self.weights @ self.draws)

    def uncertainty(self) -> Uncertainty:
        """Return the weighted draws' covariance."""
        centred = self.draws - self.mean
        covariance = (self.weights[:, None] * centred).T @ centred
        return Uncertainty(self.names, covariance, "importance sampling")

    def interval(self, level: float = 0.95) -> Array:
        """Return central credible intervals, (p, 2), of the parameters [SI]."""
        check_level(level, "interval")
        ends = np.empty((len(self.names), 2))
        for i, x in enumerate(self.draws.T):
            order = np.argsort(x)
            weights = self.weights[order]
            below = np.cumsum(weights) - weights / 2
            ends[i] = np.interp([(1 - level) / 2, (1 + level) / 2], below, x[order])
        return np.asarray(np.exp(ends))

    def resampled(self, n: int, rng: np.random.Generator) -> Array:
        """Return n draws of ln theta (n, p) of equal weight, some of them repeated."""
        return np.asarray(self.draws[rng.choice(len(self.draws), n, p=self.weights)])

    def __str__(self) -> str:
        word = "trusted" if self.trusted else "NOT to be trusted: sample with emcee instead"
        return (
            f"importance sampling: {word}; Pareto k {self.pareto_k:.2f} (at most "
            f"{self.limit:.2f}), {self.ess:.0f} effective of {len(self.draws)} draws"
        )


def importance_sample(
    fit: FittedModel,
    *,
    rng: np.random.Generator,
    draws: int = 20_000,
    dof: float = DOF,
    noise: str = "known",
    scale: float | None = None,
    prior: Prior | None = None,
    progress: Progress | None = None,
) -> ImportanceSample:
    """Return weighted draws from the posterior that `sample_posterior` samples.

    They come from a Student t about the mode with the curvature there as its scale. That serves
    posteriors that are nearly normal; where it does not, Pareto k tells (Vehtari et al. 2024).

    Parameters
    ----------
    draws : int
        Draws at least 100.
    dof : float
        Degrees of freedom of the proposal.
    noise : str
        As in `sample_posterior`.
    scale : float, optional
        As in `sample_posterior`.
    prior : Prior, optional
        As in `sample_posterior`.
    progress : Progress, optional
        Called with the draws evaluated and their total.

    Raises
    ------
    InvalidInput
        For fewer than 100 draws, or as `sample_posterior`.
    SolverFailed
        If no draw has a finite cost.
    """
    if draws < 100:
        raise InvalidInput(f"draws: {draws}; at least 100 are needed")
    density = posterior_density(fit, noise=noise, scale=scale, prior=prior)
    proposal = laplace(fit, density, dof)
    x = proposal.draw(draws, rng)
    values = np.empty(draws)
    for first in range(0, draws, BATCH):
        values[first : first + BATCH] = density(x[first : first + BATCH])
        if progress is not None:
            progress(min(first + BATCH, draws), draws)
    raw = values - proposal.log_density(x)
    log_weights, k = smoothed(raw)
    ess = 1 / float(np.sum(np.exp(2 * log_weights)))
    return ImportanceSample(density.names, read_only(x), read_only(log_weights), k, ess)


def smoothed(raw: Array) -> tuple[Array, float]:
    """Return Pareto smoothed log weights (N,), normalised, and Pareto k.

    Raises
    ------
    SolverFailed
        If no weight is positive.
    """
    positive = np.isfinite(raw)
    if not positive.any():
        raise SolverFailed(
            "importance sampling: no draw has a finite cost; the posterior is far from normal, "
            "sample it with emcee"
        )
    # Draws outside the support have no weight and no part in the tail.
    result = np.full(len(raw), -np.inf)
    result[positive], k = pareto_smoothed(raw[positive])
    return result, k
