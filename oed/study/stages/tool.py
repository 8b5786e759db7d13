"""The stage ``tool``: stiffness of the end of the last link, modes of the robot, with bands."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estimators.fitting.fitted_model import FittedModel
from estimators.sampling.exported_draws import fit_draws
from estimators.sampling.posterior import Posterior
from estimators.uncertainty.covariance import Uncertainty
from estimators.uncertainty.recommended import recommended_uncertainty
from estimators.validation.predict import Prediction, predict
from estimators.validation.predict_tool import ToolPrediction, predict_tool
from estimators.validation.quantities import free_modes
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from robotmodels.common.arrays import Array
from robotmodels.common.process_pool import elsewhere
from robotmodels.common.progress import Progress

_POSITIONS, _DRAWS = 24, 200
"""Positions of the plan, at most, and draws of a posterior for the bands."""


@dataclass(frozen=True, eq=False)
class PredictedMotions:
    """What the result predicts in the plan's first positions.

    Attributes
    ----------
    tool : ToolPrediction
        Compliance and modes of the end of the last link, motors clamped.
    free_modes : Prediction
        Of `estimators.validation.quantities.free_modes`, (Q, 2, k).
    """

    tool: ToolPrediction
    free_modes: Prediction


def tool(
    run: Run,
    result: Stage[SelectedFit],
    covariances: Stage[Uncertainty] | None,
    posterior: Stage[Posterior] | None,
    positions: Array,
) -> Stage[PredictedMotions] | None:
    """Return compliance and modes in the plan's positions (Q, n) [rad]; None without a covariance.

    Not in more than the first 24. Bands are those of the posterior if there is one that converged.
    """
    if covariances is None:
        return None
    shown = positions[:_POSITIONS]

    def compute(folder: Path, report: Progress | None) -> PredictedMotions:
        fit, draws, spread = result.value.fit, None, None
        if posterior is not None and posterior.value.converged:
            draws = fit_draws(fit, posterior.value.draws, _DRAWS, np.random.default_rng(0))
            spread = posterior.value.uncertainty()
        return elsewhere(run.executor, _predicted, fit, shown, draws, spread)

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "covariances": covariances.digest,
        "posterior": None if posterior is None else posterior.digest,
        "positions": shown.tolist(),
    }
    return run.stages.run("tool", inputs, compute, dataclass_files(PredictedMotions))


def _predicted(
    fit: FittedModel, positions: Array, draws: Array | None, spread: Uncertainty | None
) -> PredictedMotions:
    """Return the predictions; modes by the delta method, which draws would take long for."""
    spread = recommended_uncertainty(fit) if spread is None else spread
    return PredictedMotions(
        predict_tool(fit, positions, spread=spread if draws is None else draws),
        predict(fit, free_modes, positions, spread=spread),
    )
