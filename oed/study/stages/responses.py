"""The stage ``responses``: how certain FRFs of the result are, and where others would lie."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.frf.frf_estimate import FrfEstimate
from estimators.sampling.posterior import Posterior
from estimators.uncertainty.covariance import Uncertainty
from oed.criteria.prediction_variance import log_frf_gradients, prediction_std
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.data import Data
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from robotmodels.common.arrays import Array
from robotmodels.common.process_pool import elsewhere
from robotmodels.common.progress import Progress
from robotmodels.linear.derived_models import WithParameters

_DRAWS = 200  # of the posterior, for its predictive band


@dataclass(frozen=True, eq=False)
class PredictedResponses:
    """FRFs of the result in the positions and at the lines of the data.

    Attributes
    ----------
    std : ndarray, (Q, F, m, n), dimensionless
        Relative standard deviations by the parameters' covariance.
    predictive : ndarray, (2, Q, F, m, n), or None
        Ends of the 95 % posterior predictive band of measured magnitudes; None without a posterior
        that converged.
    """

    std: Array
    predictive: Array | None


def responses(
    run: Run,
    data: Stage[Data],
    result: Stage[SelectedFit],
    covariances: Stage[Uncertainty] | None,
    posterior: Stage[Posterior] | None,
) -> Stage[PredictedResponses] | None:
    """Return how certain FRFs are; None without a covariance, or where the data are runs."""
    estimate = data.value.estimate
    if covariances is None or not isinstance(estimate, FrfEstimate):
        return None

    def compute(folder: Path, report: Progress | None) -> PredictedResponses:
        fitted = WithParameters(run.robot, result.value.fit.parameters.values)
        draws = None
        if posterior is not None and posterior.value.converged:
            draws = posterior.value.draws[:: -(-len(posterior.value.draws) // _DRAWS)]
        covariance = covariances.value.covariance
        return elsewhere(run.executor, _predicted, fitted, estimate, covariance, draws)

    inputs = {
        "robot": run.robot_digest,
        "data": data.digest,
        "result": result.digest,
        "covariances": covariances.digest,
        "posterior": None if posterior is None else posterior.digest,
    }
    return run.stages.run("responses", inputs, compute, dataclass_files(PredictedResponses))


def _predicted(
    fitted: WithParameters, estimate: FrfEstimate, covariance: Array, draws: Array | None
) -> PredictedResponses:
    # Imported here: whose band is stored needs no compiled code.
    from estimators.validation.predictive_band import predictive_band

    at, omega = estimate.positions, estimate.omega
    std = prediction_std(log_frf_gradients(fitted, at, omega), covariance)
    if draws is None:
        return PredictedResponses(std, None)
    band = predictive_band(fitted.model, at, omega, draws, np.sqrt(estimate.variance))
    return PredictedResponses(std, np.stack(band))
