"""Key figures of results: terminal, JSON and page show these, computed once."""

from dataclasses import dataclass

import numpy as np

from estimators.trust.trust import Trust
from oed.study.parts import DesignedPlan, Fits, MeasuredPlan, UncertaintyOfResult


@dataclass(frozen=True)
class NamedStd:
    """Relative standard deviation of a parameter; infinite if undetermined."""

    name: str
    std: float


@dataclass(frozen=True, eq=False)
class PlanSummary:
    """Key figures of a plan.

    Attributes
    ----------
    candidates, positions : int
        Candidates, and how many of them are measured in.
    experiments, runs : int
        Experiments (visits to a position), and all their runs.
    gap : float
        Certified gap of the relaxed optimum.
    efficiency : float
        Certified lower bound of the plan's efficiency against it.
    predicted : tuple of NamedStd
        Standard deviation of each parameter by the plan's information.
    best, worst : NamedStd
        The parameters of the least and of the largest one.
    weak : tuple of str
        Combinations of parameters that the plan hardly tells, in words.
    """

    candidates: int
    positions: int
    experiments: int
    runs: int
    gap: float
    efficiency: float
    predicted: tuple[NamedStd, ...]
    best: NamedStd
    worst: NamedStd
    weak: tuple[str, ...]


def summarise_plan(plan: DesignedPlan | MeasuredPlan) -> PlanSummary:
    """Return the key figures of a plan."""
    prediction = plan.predicted
    predicted = _named(prediction.names, prediction.std)
    return PlanSummary(
        candidates=len(plan.information.positions),
        positions=len(plan.used),
        experiments=plan.visits,
        runs=plan.runs,
        gap=float(plan.design.gap),
        efficiency=float(plan.exact.efficiency),
        predicted=predicted,
        best=predicted[int(np.argmin(prediction.std))],
        worst=predicted[int(np.argmax(prediction.std))],
        weak=tuple(prediction.weak()),
    )


@dataclass(frozen=True)
class Reached:
    """Starts of an estimator that ended at its best cost, and all of its starts."""

    estimator: str
    count: int
    starts: int


@dataclass(frozen=True, eq=False)
class FitSummary:
    """Key figures of the fits and of the recommended intervals.

    Attributes
    ----------
    residual, origin, message : str
        Residual of the result, where its search began and how it ended.
    cost : float
        Cost of the result.
    converged : bool
        Whether its search converged.
    at_bounds : dict of str to str
        Parameters at a bound of the fit, and which.
    reached : tuple of Reached
        Starts at the best cost, estimator by estimator.
    residual_ratio, residual_probability : float
        Residuals over those that noise explains, and the probability of as much by chance.
    usable : tuple of int
        Parameters that have an interval with two ends, the most certain first.
    spread : tuple of float
        Least, geometric mean and largest recommended standard deviation of these; NaN of none.
    """

    residual: str
    cost: float
    origin: str
    converged: bool
    message: str
    at_bounds: dict[str, str]
    reached: tuple[Reached, ...]
    residual_ratio: float
    residual_probability: float
    usable: tuple[int, ...]
    spread: tuple[float, float, float]


def summarise_fits(fits: Fits, trust: Trust) -> FitSummary:
    """Return the key figures of fits and of the intervals that are recommended."""
    best = fits.result
    usable = [i for i, one in enumerate(trust.intervals) if one.verdict.gives_interval]
    std = trust.std[usable]
    spread = (np.nan,) * 3
    if std.size:
        spread = float(std.min()), float(np.exp(np.log(std).mean())), float(std.max())
    return FitSummary(
        residual=best.residual,
        cost=float(best.cost),
        origin=fits.origin,
        converged=best.converged,
        message=best.message,
        at_bounds=dict(best.at_bounds),
        reached=tuple(
            Reached(name, search.reached(fits.best_cost(name)), len(search.runs))
            for name, search in fits.searches.items()
        ),
        residual_ratio=trust.size.ratio,
        residual_probability=trust.size.probability,
        usable=tuple(sorted(usable, key=lambda i: trust.std[i])),
        spread=spread,
    )


@dataclass(frozen=True, eq=False)
class PosteriorSummary:
    """Key figures of a posterior.

    Attributes
    ----------
    r_hat, ess : float
        Largest R-hat and least effective sample size of all parameters.
    converged : bool
        Whether these are good enough.
    message : str
        If not, which parameter is worst and what to do.
    """

    r_hat: float
    ess: float
    converged: bool
    message: str


@dataclass(frozen=True, eq=False)
class UncertaintySummary:
    """Key figures of the uncertainty by several methods; None where a method failed.

    Attributes
    ----------
    theorem1 : tuple of NamedStd or None
        Standard deviations by Theorem 1.
    posterior : PosteriorSummary or None
        Convergence of the posterior.
    ratio : tuple of float or None
        Least and largest standard deviation by Theorem 1 over that of the posterior.
    agreeing : tuple of str or None
        Methods that agree with the recommended one.
    """

    theorem1: tuple[NamedStd, ...] | None
    posterior: PosteriorSummary | None
    ratio: tuple[float, float] | None
    agreeing: tuple[str, ...] | None


def summarise_uncertainty(uncertainty: UncertaintyOfResult) -> UncertaintySummary:
    """Return the key figures of the uncertainty of a result."""
    theorem1, posterior = uncertainty.theorem1, uncertainty.posterior
    check = uncertainty.cross_check
    ratio = uncertainty.std / uncertainty.sampled_std
    return UncertaintySummary(
        theorem1=None if theorem1 is None else _named(theorem1.names, theorem1.std),
        posterior=None
        if posterior is None
        else PosteriorSummary(
            r_hat=float(np.max(posterior.r_hat)),
            ess=float(np.min(posterior.ess)),
            converged=posterior.converged,
            message=posterior.message,
        ),
        ratio=None if np.isnan(ratio).all() else (float(ratio.min()), float(ratio.max())),
        agreeing=None if check is None else check.agreeing(),
    )


def _named(names: tuple[str, ...], std: np.ndarray) -> tuple[NamedStd, ...]:
    return tuple(NamedStd(name, float(s)) for name, s in zip(names, std, strict=True))
