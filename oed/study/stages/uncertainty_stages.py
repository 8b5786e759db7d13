"""The stages of a study that say how far to trust its result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from estimators.fitting.least_squares import Fit, likelihood_fit
from estimators.sampling.convergence import StoppingCriterion
from estimators.sampling.importance_sampling import importance_sample
from estimators.sampling.log_posterior import has_noise_weights
from estimators.sampling.posterior import Posterior, check_sizes, sample_posterior
from estimators.sampling.profile_likelihood import Profile, profile_likelihood
from estimators.uncertainty.covariance import Uncertainty, covariance
from estimators.validation.cross_check import CrossCheck, cross_check
from estimators.validation.monte_carlo import MonteCarlo
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.stages.context import Run
from oed.study.stages.fit_stages import Chosen, Search
from oed.study.stages.serialisation import dataclass_files
from oed.study.stages.stage_cache import Stage
from robotmodels.common.errors import IdentificationError, InvalidInput
from robotmodels.common.progress import Progress

T = TypeVar("T")

THIN = 5
"""Steps between stored snapshots of the chains."""


def check_posterior(run: Run) -> None:
    """Refuse a posterior that cannot be sampled before hours are spent on what comes before.

    Raises
    ------
    InvalidInput
        For too few walkers or steps.
    """
    choice = run.study.posterior
    try:
        check_sizes(len(run.robot.parameters), choice.ensembles, choice.walkers, choice.steps, THIN)
    except InvalidInput as error:
        raise InvalidInput(f"posterior.{error}") from None


def theorem1(run: Run, result: Stage[Chosen]) -> Stage[Uncertainty]:
    """Return the covariance of the result by [WM] Theorem 1."""
    fit = result.value.fit

    def compute(folder: Path, report: Progress | None) -> Uncertainty:
        return covariance(fit)

    inputs = {"robot": run.robot_digest, "result": result.digest}
    return run.stages.run("uncertainty", inputs, compute, dataclass_files(Uncertainty))


def needed(covariances: Stage[Uncertainty] | None) -> Stage[Uncertainty]:
    """Return the covariance.

    Raises
    ------
    IdentificationError
        If it could not be computed.
    """
    if covariances is None:
        raise IdentificationError("it rests on the covariance, which could not be computed")
    return covariances


def posterior(run: Run, result: Stage[Chosen]) -> Stage[Posterior]:
    """Return the posterior of the likelihood; its chains outlive an interruption.

    The density is exp(-V), V the cost with the noise's weights; a result with other weights is
    fitted once more with these.
    """
    return _sampled(run, result, "posterior", likelihood_of)


def own_cost(run: Run, result: Stage[Chosen]) -> Stage[Posterior] | None:
    """Return draws by the result's own cost, where its weights are not those of the noise."""
    if has_noise_weights(result.value.fit):
        return None
    return _sampled(run, result, "own-cost", lambda fit: fit)


def likelihood_of(fit: Fit) -> Fit:
    """Return the fit whose cost is the likelihood: itself if its weights are the noise's."""
    return fit if has_noise_weights(fit) else likelihood_fit(fit)


def _sampled(
    run: Run, result: Stage[Chosen], name: str, density: Callable[[Fit], Fit]
) -> Stage[Posterior]:
    choice = run.study.posterior

    def compute(folder: Path, report: Progress | None) -> Posterior:
        return sample_posterior(
            density(result.value.fit),
            rng=run.rng(name),
            ensembles=choice.ensembles,
            walkers=choice.walkers,
            steps=choice.steps,
            thin=THIN,
            target=StoppingCriterion(r_hat=choice.r_hat, ess=choice.ess),
            backend=folder / "posterior.h5",
            progress=report,
            executor=run.executor,
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        **run.settings("posterior", "seed"),
    }
    return run.stages.run(name, inputs, compute, dataclass_files(Posterior))


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profile likelihoods of some parameters."""

    found: tuple[Profile, ...]


def profiles(
    run: Run, result: Stage[Chosen], covariances: Stage[Uncertainty] | None
) -> Stage[Profiles] | None:
    """Return profile likelihoods of the least certain parameters, as many as the study asks for.

    Raises
    ------
    IdentificationError
        Without covariances.
    """
    count = run.study.profiles
    if not count:
        return None
    stated, fit = needed(covariances).value, result.value.fit
    chosen = np.sort(np.argsort(-stated.std, kind="stable")[:count])
    names = [stated.names[i] for i in chosen]

    def compute(folder: Path, report: Progress | None) -> Profiles:
        pool = run.executor
        return Profiles(profile_likelihood(fit, names, executor=pool, progress=report))

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "parameters": names,
    }
    return run.stages.run("profiles", inputs, compute, dataclass_files(Profiles))


@dataclass(frozen=True, eq=False)
class Known:
    """What the stages before a cross-check found, as far as there are any."""

    covariances: Stage[Uncertainty] | None
    posterior: Stage[Posterior] | None
    own_cost: Stage[Posterior] | None
    profiles: Stage[Profiles] | None
    comparison: Stage[PlanComparison] | None


def checked(
    run: Run, result: Stage[Chosen], known: Known, searches: Mapping[str, Stage[Search]]
) -> Stage[CrossCheck]:
    """Return what the methods say of each parameter, side by side, with a verdict."""
    name = run.study.fit.result or _likelihood(searches)
    runs: tuple[Fit, ...] = () if name is None else searches[name].value.runs
    repeated = _repeated(run, result, known)
    fit = result.value.fit

    def compute(folder: Path, report: Progress | None) -> CrossCheck:
        return cross_check(
            fit,
            theorem1=_value(known.covariances),
            posterior=_value(known.posterior),
            own_cost=_value(known.own_cost),
            importance=importance_sample(likelihood_of(fit), rng=run.rng("importance")),
            profiles=() if known.profiles is None else known.profiles.value.found,
            monte_carlo=repeated,
            multistart=[one for one in runs if one.converged],
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "uncertainty": _digest(known.covariances),
        "posterior": _digest(known.posterior),
        "own cost": _digest(known.own_cost),
        "profiles": _digest(known.profiles),
        "comparison": _digest(known.comparison),
        "repeated": repeated is not None,
        "runs": None if name is None else searches[name].digest,
        **run.settings("seed"),
    }
    return run.stages.run("cross-check", inputs, compute, dataclass_files(CrossCheck))


def _value(stage: Stage[T] | None) -> T | None:
    return None if stage is None else stage.value


def _digest(stage: Stage[object] | None) -> str | None:
    return None if stage is None else stage.digest


def _repeated(run: Run, result: Stage[Chosen], known: Known) -> MonteCarlo | None:
    """Return repeated experiments by the plan, where the data and the fit are of the same kind."""
    by_law = run.study.data.experiment is None and run.plant is run.robot
    likelihood = result.value.fit.residual == "nls" and run.study.fit.result is None
    if known.comparison is None or not (by_law and likelihood):
        return None
    return known.comparison.value.plans[0].simulation


def _likelihood(searches: Mapping[str, Stage[Search]]) -> str | None:
    """Return the estimator whose cost is the likelihood, if one of them is."""
    return next((name for name, one in searches.items() if one.value.is_likelihood), None)
