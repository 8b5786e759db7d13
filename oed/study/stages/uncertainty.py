"""The stage ``uncertainty``: the covariance of the result by [WM] Theorem 1."""

from pathlib import Path

from estimators.uncertainty.covariance import Uncertainty, covariance
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from robotmodels.common.errors import IdentificationError
from robotmodels.common.progress import Progress


def uncertainty(run: Run, result: Stage[SelectedFit]) -> Stage[Uncertainty]:
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
        raise IdentificationError("it needs the covariance, which could not be computed")
    return covariances
