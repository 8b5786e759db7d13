"""The stages of a study that say how far to trust its result."""

from pathlib import Path

from estimators.convergence import Target
from estimators.covariance import Uncertainty, covariance
from estimators.posterior import Posterior, sample_posterior
from oed.stage_files import dataclass_files
from oed.stages import Report, Stage
from oed.study_fits import Chosen
from oed.study_run import Run


def theorem1(run: Run, result: Stage[Chosen]) -> Stage[Uncertainty]:
    """Return the covariance of the result by [WM] Theorem 1."""

    def compute(folder: Path, report: Report | None) -> Uncertainty:
        return covariance(result.value.fit)

    inputs = {"robot": run.robot_digest, "result": result.digest}
    return run.stages.run("uncertainty", inputs, compute, dataclass_files(Uncertainty))


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
