"""The stage ``residuals``: what the result leaves unexplained, and what its data tell."""

from dataclasses import dataclass
from pathlib import Path

from estimators.fitting.fitted_model import FittedModel
from estimators.uncertainty.identifiability import fit_information
from estimators.uncertainty.residual_analysis import LAGS, ResidualAnalysis, residual_analysis
from estimators.uncertainty.standardised_residuals import standardised_residuals
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from robotmodels.common.arrays import Array
from robotmodels.common.progress import Progress


@dataclass(frozen=True, eq=False)
class FitResiduals:
    """A fit linearised about its solution.

    Attributes
    ----------
    analysis : ResidualAnalysis
        What the fit leaves unexplained.
    standardised : ndarray, (parts, Q, F, k)
        Residuals over their standard deviations, see `standardised_residuals`.
    information : ndarray, (p, p)
        Information of the data on ln theta.
    noise_weights : bool
        Whether the weights are those of the noise.
    """

    analysis: ResidualAnalysis
    standardised: Array
    information: Array
    noise_weights: bool

    @classmethod
    def of(cls, fit: FittedModel) -> "FitResiduals":
        """Linearise a fit."""
        return cls(
            analysed(fit), standardised_residuals(fit), fit_information(fit), fit.has_likelihood
        )


def analysed(fit: FittedModel) -> ResidualAnalysis:
    """Return what a fit leaves unexplained, by as many lags as it has lines."""
    return residual_analysis(fit, max(min(LAGS, len(fit.problem.omega) - 1), 1))


def residuals(run: Run, result: Stage[SelectedFit]) -> Stage[FitResiduals]:
    """Return what the result leaves unexplained."""

    def compute(folder: Path, report: Progress | None) -> FitResiduals:
        return FitResiduals.of(result.value.fit)

    inputs = {"robot": run.robot_digest, "result": result.digest}
    return run.stages.run("residuals", inputs, compute, dataclass_files(FitResiduals))
