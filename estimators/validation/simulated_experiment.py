"""One simulated experiment, its fit, and the interval of each method."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.fitting.fit_problem import FitProblem
from estimators.fitting.fixed_equilibrium_search import share_kernel
from estimators.fitting.frf_problem import FrfProblem
from estimators.fitting.gauss_newton import gauss_newton
from estimators.fitting.least_squares import Fit, fit_problem, solved
from estimators.fitting.run_fit import RunFit
from estimators.frf.frf_estimate import FrfEstimate, exact_frf
from estimators.uncertainty.covariance import METHODS, covariance
from robotmodels.common.arrays import Array, ComplexArray, IntArray
from robotmodels.common.errors import IdentificationError, InvalidInput, nearest
from robotmodels.linear.noise import NoiseLaw
from robotmodels.linear.response import Elastic, frequency_response

Experiment = Callable[[np.random.Generator], FrfEstimate]


@dataclass(frozen=True, eq=False)
class FrfExperiment:
    """An experiment at the level of FRFs: the true model's, with errors of a noise law.

    Attributes
    ----------
    model : Elastic
        The true one.
    positions : ndarray
        As in `estimators.simulate_frf`.
    omega : ndarray
        As in `estimators.simulate_frf`.
    noise : NoiseLaw
        As in `estimators.simulate_frf`.
    repetitions : ndarray of int or None
        As in `estimators.simulate_frf`.
    """

    model: Elastic
    positions: Array
    omega: Array
    noise: NoiseLaw
    repetitions: IntArray | None = None

    @cached_property
    def response(self) -> ComplexArray:
        """The true FRFs, (Q, F, m, n), computed once for all runs."""
        return np.asarray(frequency_response(self.model, self.positions, self.omega))

    @cached_property
    def _exact(self) -> FrfEstimate:
        """The true FRFs with the variances of their errors."""
        return exact_frf(self.response, self.positions, self.omega, self.noise, self.repetitions)

    def __call__(self, rng: np.random.Generator) -> FrfEstimate:
        """Return one simulated estimate."""
        return self._exact.with_errors(rng)


@dataclass(frozen=True, eq=False)
class RunSettings:
    """What is done with every simulated experiment; arguments of `monte_carlo`."""

    experiment: Experiment
    model: Elastic
    residual: str
    weights: str | NDArray[Any]
    methods: tuple[str, ...]
    level: float
    noise: str

    def several(self, seeds: Sequence[int]) -> "list[dict[str, Array] | str]":
        """Return the arrays of each run, or the reason why there are none."""
        results: list[dict[str, Array] | str] = []
        prepared: FrfProblem | None = None
        for seed in seeds:
            rng = np.random.default_rng(seed)
            try:
                problem = fit_problem(self.model, self.experiment(rng), self.residual, self.weights)
                if isinstance(problem, FrfProblem):
                    if prepared is not None and _alike(problem, prepared):
                        share_kernel(problem, prepared)
                    prepared = problem
                results.append(self._arrays(problem, rng))
            except (IdentificationError, np.linalg.LinAlgError) as error:
                results.append(str(error))
        return results

    def _arrays(self, problem: FitProblem, rng: np.random.Generator) -> "dict[str, Array] | str":
        """Return the arrays of the run with that problem, or why its search did not converge."""
        p = len(self.model.parameters)
        start = problem.checked_start(None)
        fitted = solved(problem, start, minimise=gauss_newton)
        if not fitted.converged:
            return f"not converged: {fitted.message}"
        stds, ends = np.empty((len(self.methods), p)), np.empty((len(self.methods), p, 2))
        for i, method in enumerate(self.methods):
            stds[i], ends[i] = intervals_of(fitted, method, self.level, rng, noise=self.noise)
        return {
            "estimates": np.log(fitted.parameters.values),
            "stds": stds,
            "intervals": ends,
            "costs": np.array(fitted.cost),
        }


def _alike(problem: FrfProblem, other: FrfProblem) -> bool:
    """Whether two problems are of the same positions and lines."""
    return all(map(np.array_equal, *((one.positions, one.omega) for one in (problem, other))))


INTERVAL_METHODS = ("recommended", *METHODS, "posterior", "profile")
# Of the posterior's draws: an interval's ends to about a twentieth of a standard deviation.
DRAWS, ESS = 4000, 1000.0


def intervals_of(
    fit: Fit | RunFit,
    method: str,
    level: float,
    rng: np.random.Generator,
    *,
    noise: str = "known",
) -> tuple[Array, Array]:
    """Return standard deviations (p,) and intervals (p, 2) of ln theta.

    Parameters
    ----------
    fit : Fit or RunFit
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
        from estimators.sampling.profile_likelihood import profile_likelihood

        profiles = profile_likelihood(fit, level=level, noise=noise)
        ends = np.log([[p.lower, p.upper] for p in profiles])
        return np.array([p.std for p in profiles]), ends
    raise InvalidInput(
        f"method {method!r} is none of {', '.join(INTERVAL_METHODS)}"
        f"{nearest(method, INTERVAL_METHODS)}"
    )


def _posterior(
    fit: Fit | RunFit, level: float, rng: np.random.Generator, noise: str
) -> tuple[Array, Array]:
    from estimators.sampling.importance_sampling import importance_sample

    sample = importance_sample(fit, rng=rng, draws=DRAWS, noise=noise)
    if sample.trusted and sample.ess >= ESS:
        return sample.uncertainty().std, np.log(sample.interval(level))
    from estimators.sampling.convergence import StoppingCriterion
    from estimators.sampling.posterior import sample_posterior

    walkers = max(2 * len(fit.parameters), 16)
    posterior = sample_posterior(
        fit, rng=rng, walkers=walkers, target=StoppingCriterion(ess=ESS), noise=noise
    )
    return posterior.uncertainty().std, np.log(posterior.interval(level))
