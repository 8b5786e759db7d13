"""The stages ``posterior`` and ``cost-posterior``: draws of the parameters, by emcee.

The first samples the likelihood of the noise, the second the result's own cost where its weights
are not those of the noise; the sampler and its settings are the same.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from estimators.fitting.least_squares import Fit, likelihood_fit
from estimators.fitting.run_fit import RunFit
from estimators.sampling.convergence import StoppingCriterion
from estimators.sampling.posterior import Posterior, check_sizes, sample_posterior
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.residuals import FitResiduals
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from robotmodels.common.errors import InvalidInput
from robotmodels.common.process_pool import ProcessPool
from robotmodels.common.progress import Progress

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


def posterior(run: Run, result: Stage[SelectedFit]) -> Stage[Posterior]:
    """Return the posterior of the likelihood; its chains outlive an interruption.

    The density is exp(-V), V the cost with the noise's weights; a result with other weights is
    fitted once more with these.
    """
    return _sampled(run, result, "posterior", likelihood_fit)


def cost_posterior(
    run: Run, result: Stage[SelectedFit], residuals: FitResiduals | None
) -> Stage[Posterior] | None:
    """Return draws by the result's cost, if its weights are not those of the noise."""
    fit = result.value.fit
    if fit.has_likelihood if residuals is None else residuals.noise_weights:
        return None
    return _sampled(run, result, "cost-posterior", lambda fit: fit)


def _sampled(
    run: Run, result: Stage[SelectedFit], name: str, density: Callable[[Fit | RunFit], Fit | RunFit]
) -> Stage[Posterior]:
    choice = run.study.posterior

    def compute(folder: Path, report: Progress | None) -> Posterior:
        if isinstance(run.executor, ProcessPool):
            run.executor.load("estimators.sampling.moves")  # while this one prepares
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

    return run.stages.run(name, _inputs(run, result), compute, dataclass_files(Posterior))


def stored_posterior(run: Run, result: Stage[SelectedFit]) -> Posterior | None:
    """Return the posterior that an earlier run sampled; None without one that converged."""
    stage = run.stages.stored("posterior", _inputs(run, result), dataclass_files(Posterior))
    return stage.value if stage is not None and stage.value.converged else None


def _inputs(run: Run, result: Stage[SelectedFit]) -> dict[str, Any]:
    settings = run.settings("posterior", "seed")
    return {"robot": run.robot_digest, "result": result.digest, **settings}
