"""The stage ``tool``: how stiff the end of the last link is at the result, with bands."""

from pathlib import Path

import numpy as np

from estimators.sampling.exported_draws import fit_draws
from estimators.sampling.posterior import Posterior
from estimators.uncertainty.covariance import Uncertainty
from estimators.validation.predict_tool import ToolPrediction, predict_tool
from oed.study.stage_cache import Stage, dataclass_files
from oed.study.stages.result import SelectedFit
from oed.study.stages.run import Run
from robotmodels.common.arrays import Array
from robotmodels.common.process_pool import elsewhere
from robotmodels.common.progress import Progress

_POSITIONS, _DRAWS = 24, 200
"""Positions of the plan, at most, and draws of a posterior for the bands."""


def tool(
    run: Run,
    result: Stage[SelectedFit],
    covariances: Stage[Uncertainty] | None,
    posterior: Stage[Posterior] | None,
    positions: Array,
) -> Stage[ToolPrediction] | None:
    """Return compliance and modes in the plan's positions (Q, n) [rad]; None without a covariance.

    Not in more than the first 24. Bands are those of the posterior if there is one that converged.
    """
    if covariances is None:
        return None
    shown = positions[:_POSITIONS]

    def compute(folder: Path, report: Progress | None) -> ToolPrediction:
        fit, spread = result.value.fit, None
        if posterior is not None and posterior.value.converged:
            rng = np.random.default_rng(0)
            spread = fit_draws(fit, posterior.value.draws, _DRAWS, rng)
        return elsewhere(run.executor, predict_tool, fit, shown, spread=spread)

    inputs = {
        "robot": run.robot_digest,
        "result": result.digest,
        "covariances": covariances.digest,
        "posterior": None if posterior is None else posterior.digest,
        "positions": shown.tolist(),
    }
    return run.stages.run("tool", inputs, compute, dataclass_files(ToolPrediction))
