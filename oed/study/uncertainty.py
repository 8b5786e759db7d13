"""The stages of a study that say how far to trust its result."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.fitting.least_squares import Fit
from estimators.uncertainty.convergence import Target
from estimators.uncertainty.covariance import Uncertainty, covariance
from estimators.uncertainty.cross_check import CrossCheck, cross_check
from estimators.uncertainty.estimated_noise import least_blocks, weights_are_inverse
from estimators.uncertainty.importance import importance_sample
from estimators.uncertainty.log_posterior import magnitude_adjustment
from estimators.uncertainty.monte_carlo import MonteCarlo
from estimators.uncertainty.posterior import Posterior, check_sizes, sample_posterior
from estimators.uncertainty.profile import Profile, profile_likelihood
from oed.study.fits import Chosen, Search
from oed.study.run import Run
from oed.study.stage_files import dataclass_files
from oed.study.stages import Report, Stage
from oed.trials.outcome import PlanComparison
from robotmodels.errors import IdentificationError, InvalidInput

THIN = 5
"""Steps between stored snapshots of the chains."""


@dataclass(frozen=True, eq=False)
class Covariances:
    """Theorem 1 with the stated noise, and with what the residuals show instead.

    Attributes
    ----------
    theorem1, empirical : both covariances.
    blocks : over which the noise was estimated that the weights are made of, see `counted_blocks`.
    scale : factor of the cost at which a posterior allows for these blocks; None without them.
    """

    theorem1: Uncertainty
    empirical: Uncertainty
    blocks: int | None
    scale: float | None


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


def _over_blocks(run: Run) -> bool:
    """Tell whether the noise was estimated over blocks, not known or told by other means."""
    choice = run.study.data
    measured = choice.experiment is not None or choice.records is not None
    return choice.covariance == "total" and measured


def counted_blocks(fit: Fit) -> int | None:
    """Return over how many blocks the noise was estimated that the result's weights are made of.

    None where the weights do not depend on it, or the blocks are too few to allow for that.
    """
    if not np.isfinite(fit.cost) or not weights_are_inverse(fit):
        return None
    fewest = int(fit.estimate.repetitions.min())
    return fewest if fewest >= least_blocks(fit) else None


def covariances(run: Run, result: Stage[Chosen]) -> Stage[Covariances]:
    """Return the covariance of the result by [WM] Theorem 1, two ways."""
    fit, over_blocks = result.value.fit, _over_blocks(run)

    def compute(folder: Path, report: Report | None) -> Covariances:
        blocks = counted_blocks(fit) if over_blocks else None
        scale = None if blocks is None else magnitude_adjustment(fit, blocks)
        theorem1, empirical = covariance(fit, blocks=blocks), covariance(fit, "empirical")
        return Covariances(theorem1, empirical, blocks, scale)

    inputs = {"robot": run.robot_digest, "result": result.digest, "over blocks": over_blocks}
    return run.stages.run("uncertainty", inputs, compute, dataclass_files(Covariances))


def needed(known: Stage[Covariances] | None) -> Stage[Covariances]:
    """Return the covariances.

    Raises
    ------
    IdentificationError : if they could not be computed.
    """
    if known is None:
        raise IdentificationError("it rests on the covariances, which could not be computed")
    return known


def posterior(
    run: Run, result: Stage[Chosen], known: Stage[Covariances] | None
) -> Stage[Posterior]:
    """Return the posterior of the result; its chains outlive an interruption."""
    choice, scale = run.study.posterior, None if known is None else known.value.scale

    def compute(folder: Path, report: Report | None) -> Posterior:
        return sample_posterior(
            result.value.fit,
            rng=run.rng("posterior"),
            ensembles=choice.ensembles,
            walkers=choice.walkers,
            steps=choice.steps,
            thin=THIN,
            scale=scale,
            target=Target(r_hat=choice.r_hat, ess=choice.ess),
            backend=folder / "posterior.h5",
            progress=report,
            executor=run.executor,
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "scale": scale,
        **run.settings("posterior", "seed"),
    }
    return run.stages.run("posterior", inputs, compute, dataclass_files(Posterior))


@dataclass(frozen=True, eq=False)
class Profiles:
    """Profile likelihoods of some parameters."""

    found: tuple[Profile, ...]


def profiles(
    run: Run, result: Stage[Chosen], covariances: Stage[Covariances] | None
) -> Stage[Profiles] | None:
    """Return profile likelihoods of the least certain parameters, as many as the study asks for.

    Raises
    ------
    IdentificationError : without covariances.
    """
    count = run.study.profiles
    if not count:
        return None
    known = needed(covariances)
    std = known.value.theorem1.std
    chosen = np.sort(np.argsort(-std, kind="stable")[:count])
    names = [known.value.theorem1.names[i] for i in chosen]
    fit, scale = result.value.fit, known.value.scale

    def compute(folder: Path, report: Report | None) -> Profiles:
        pool = run.executor
        return Profiles(profile_likelihood(fit, names, scale=scale, executor=pool, progress=report))

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "parameters": names,
        "scale": scale,
    }
    return run.stages.run("profiles", inputs, compute, dataclass_files(Profiles))


@dataclass(frozen=True, eq=False)
class Known:
    """What the stages before a cross-check found, as far as there are any."""

    covariances: Stage[Covariances] | None
    posterior: Stage[Posterior] | None
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
    stated = None if known.covariances is None else known.covariances.value

    def compute(folder: Path, report: Report | None) -> CrossCheck:
        return cross_check(
            fit,
            theorem1=None if stated is None else stated.theorem1,
            empirical=None if stated is None else stated.empirical,
            posterior=None if known.posterior is None else known.posterior.value,
            importance=importance_sample(
                fit, rng=run.rng("importance"), scale=None if stated is None else stated.scale
            ),
            profiles=() if known.profiles is None else known.profiles.value.found,
            monte_carlo=repeated,
            multistart=[one for one in runs if one.converged],
            blocks=None if stated is None else stated.blocks,
        )

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "uncertainty": _digest(known.covariances),
        "posterior": _digest(known.posterior),
        "profiles": _digest(known.profiles),
        "comparison": _digest(known.comparison),
        "repeated": repeated is not None,
        "runs": None if name is None else searches[name].digest,
        **run.settings("seed"),
    }
    return run.stages.run("cross-check", inputs, compute, dataclass_files(CrossCheck))


def _digest(stage: Stage[object] | None) -> str | None:
    return None if stage is None else stage.digest


def _repeated(run: Run, result: Stage[Chosen], known: Known) -> MonteCarlo | None:
    """Return repeated experiments by the plan, where the data and the fit are of the same kind."""
    by_law = run.study.data.experiment is None and run.plant is run.robot
    likelihood = result.value.fit.residual == "nls" and run.study.fit.result is None
    if known.comparison is None or not (by_law and likelihood):
        return None
    return known.comparison.value.trials[0].found


def _likelihood(searches: Mapping[str, Stage[Search]]) -> str | None:
    """Return the estimator whose cost is the likelihood, if one of them is."""
    return next((name for name, one in searches.items() if one.value.is_likelihood), None)
