"""The stages of a study that say how far to trust its result."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from estimators.fitting.least_squares import Fit
from estimators.uncertainty.convergence import Target
from estimators.uncertainty.covariance import Uncertainty, covariance
from estimators.uncertainty.cross_check import CrossCheck, cross_check
from estimators.uncertainty.importance import importance_sample
from estimators.uncertainty.posterior import Posterior, check_sizes, sample_posterior
from oed.study.fits import Chosen, Search
from oed.study.run import Run
from oed.study.stage_files import dataclass_files
from oed.study.stages import Report, Stage
from robotmodels.errors import InvalidInput

THIN = 5
"""Steps between stored snapshots of the chains."""


@dataclass(frozen=True, eq=False)
class Covariances:
    """Theorem 1 with the stated noise, and with what the residuals show instead."""

    theorem1: Uncertainty
    empirical: Uncertainty


def check_posterior(run: Run) -> None:
    """Refuse a posterior that cannot be sampled before hours are spent on what comes before.

    Raises
    ------
    InvalidInput : for too few walkers or steps.
    """
    choice = run.study.posterior
    try:
        check_sizes(len(run.robot.parameters), choice.ensembles, choice.walkers, choice.steps, THIN)
    except InvalidInput as error:
        raise InvalidInput(f"posterior.{error}") from None


def covariances(run: Run, result: Stage[Chosen]) -> Stage[Covariances]:
    """Return the covariance of the result by [WM] Theorem 1, two ways."""

    def compute(folder: Path, report: Report | None) -> Covariances:
        fit = result.value.fit
        return Covariances(covariance(fit), covariance(fit, "empirical"))

    inputs = {"robot": run.robot_digest, "result": result.digest}
    return run.stages.run("uncertainty", inputs, compute, dataclass_files(Covariances))


def posterior(run: Run, result: Stage[Chosen]) -> Stage[Posterior]:
    """Return the posterior of the result; its chains outlive an interruption."""
    choice = run.study.posterior

    def compute(folder: Path, report: Report | None) -> Posterior:
        return sample_posterior(
            result.value.fit,
            rng=run.rng("posterior"),
            ensembles=choice.ensembles,
            walkers=choice.walkers,
            steps=choice.steps,
            thin=THIN,
            target=Target(r_hat=choice.r_hat, ess=choice.ess),
            backend=folder / "posterior.h5",
            progress=report,
            executor=run.executor,
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        **run.settings("posterior", "seed"),
    }
    return run.stages.run("posterior", inputs, compute, dataclass_files(Posterior))


def checked(
    run: Run,
    result: Stage[Chosen],
    known: Stage[Covariances],
    sampled: Stage[Posterior],
    searches: Mapping[str, Stage[Search]],
) -> Stage[CrossCheck]:
    """Return what the methods say of each parameter, side by side, with a verdict."""
    name = run.study.fit.result or _likelihood(searches)
    runs: tuple[Fit, ...] = () if name is None else searches[name].value.runs

    def compute(folder: Path, report: Report | None) -> CrossCheck:
        return cross_check(
            result.value.fit,
            theorem1=known.value.theorem1,
            empirical=known.value.empirical,
            posterior=sampled.value,
            importance=importance_sample(result.value.fit, rng=run.rng("importance")),
            multistart=[one for one in runs if one.converged],
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "uncertainty": known.digest,
        "posterior": sampled.digest,
        "runs": None if name is None else searches[name].digest,
        **run.settings("seed"),
    }
    return run.stages.run("cross-check", inputs, compute, dataclass_files(CrossCheck))


def _likelihood(searches: Mapping[str, Stage[Search]]) -> str | None:
    """Return the estimator whose cost is the likelihood, if one of them is."""
    return next((name for name, one in searches.items() if one.value.is_likelihood), None)
