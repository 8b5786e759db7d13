"""The stages ``importance`` and ``cross-check``: what every method says of each parameter."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from estimators.fitting.fitted_model import FittedModel
from estimators.fitting.least_squares import likelihood_fit
from estimators.sampling.importance_sampling import ImportanceSample, importance_sample
from estimators.sampling.posterior import Posterior
from estimators.sampling.profile_likelihood import Profile
from estimators.trust.trust import Trust
from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.cross_check import CrossCheck, cross_check as compare_methods
from estimators.validation.monte_carlo import MonteCarlo
from oed.plan_comparison.plan_comparison import PlanComparison
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.fit import Search
from oed.study.stages.profiles import Profiles
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from robotmodels.common.progress import Progress

T = TypeVar("T")

_DRAWS = 6_000
"""Of which more than 4 000 are effective, as of a posterior, where the proposal suits."""


@dataclass(frozen=True, eq=False)
class Importance:
    """Importance sample and trust of a result, which no setting of the posterior changes."""

    sample: ImportanceSample
    trust: Trust


@dataclass(frozen=True, eq=False)
class CrossCheckInputs:
    """The stages that a cross-check compares, as far as there are any."""

    covariances: Stage[Uncertainty] | None
    posterior: Stage[Posterior] | None
    cost_posterior: Stage[Posterior] | None
    profiles: Stage[Profiles] | None
    comparison: Stage[PlanComparison] | None
    importance: Stage[Importance] | None

    @property
    def profile_likelihoods(self) -> tuple[Profile, ...]:
        """The profile likelihoods, if there are any."""
        return () if self.profiles is None else self.profiles.value.profiles


def cross_check(
    run: Run,
    result: Stage[SelectedFit],
    methods: CrossCheckInputs,
    searches: Mapping[str, Stage[Search]],
) -> Stage[CrossCheck]:
    """Return what the methods say of each parameter, side by side, with a verdict."""
    name = run.study.fit.result or _likelihood(searches)
    runs: tuple[FittedModel, ...] = () if name is None else searches[name].value.runs
    repeated = _repeated(run, result, methods)
    fit, computed = result.value.fit, _value(methods.importance)

    def compute(folder: Path, report: Progress | None) -> CrossCheck:
        return compare_methods(
            fit,
            theorem1=_value(methods.covariances),
            posterior=_value(methods.posterior),
            cost_posterior=_value(methods.cost_posterior),
            importance=None if computed is None else computed.sample,
            trust=None if computed is None else computed.trust,
            profiles=methods.profile_likelihoods,
            monte_carlo=repeated,
            multistart=[one for one in runs if one.converged],
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "uncertainty": _digest(methods.covariances),
        "posterior": _digest(methods.posterior),
        "own cost": _digest(methods.cost_posterior),
        "profiles": _digest(methods.profiles),
        "comparison": _digest(methods.comparison),
        "importance": _digest(methods.importance),
        "repeated": repeated is not None,
        "runs": None if name is None else searches[name].digest,
    }
    return run.stages.run("cross-check", inputs, compute, dataclass_files(CrossCheck))


def importance(run: Run, result: Stage[SelectedFit]) -> Stage[Importance]:
    """Return draws of the likelihood by importance sampling, and how far the fit can be trusted."""
    fit = result.value.fit

    def compute(folder: Path, report: Progress | None) -> Importance:
        likelihood, rng = likelihood_fit(fit), run.rng("importance")
        if run.executor is None:
            return Importance(
                importance_sample(likelihood, rng=rng, draws=_DRAWS, progress=report), fit.trust
            )
        sample = run.executor.submit(importance_sample, likelihood, rng=rng, draws=_DRAWS)
        trust = fit.trust  # meanwhile
        return Importance(sample.result(), trust)

    inputs = {"robot": run.robot_digest, "result": result.digest, **run.settings("seed")}
    return run.stages.run("importance", inputs, compute, dataclass_files(Importance))


def _value(stage: Stage[T] | None) -> T | None:
    return None if stage is None else stage.value


def _digest(stage: Stage[object] | None) -> str | None:
    return None if stage is None else stage.digest


def _repeated(run: Run, result: Stage[SelectedFit], methods: CrossCheckInputs) -> MonteCarlo | None:
    """Return repeated experiments by the plan, where the data and the fit are of the same kind."""
    by_law = run.study.data.experiment is None and run.study.truth is None
    likelihood = not result.value.fit.logarithmic and run.study.fit.result is None
    if methods.comparison is None or not (by_law and likelihood):
        return None
    return methods.comparison.value.optimal.simulation


def _likelihood(searches: Mapping[str, Stage[Search]]) -> str | None:
    """Return the estimator whose cost is the likelihood, if one of them is."""
    return next((name for name, one in searches.items() if one.value.is_likelihood), None)
