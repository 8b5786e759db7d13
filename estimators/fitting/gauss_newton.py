"""Full Gauss-Newton steps, for starts so near a minimum that nothing needs to restrain them."""

from dataclasses import replace

import numpy as np

from estimators.fitting.trust_region import (
    Bounded,
    Curvature,
    Objective,
    SearchResult,
    trust_region,
)
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationError


def gauss_newton(
    problem: Bounded,
    objective: Objective,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    curvature: Curvature | None = None,
) -> SearchResult:
    """Minimise by full Gauss-Newton steps about ln theta; see `Minimiser`.

    The search ends where the next step would lower the cost by less than `tolerance` of it, by the
    linear model of the residuals; that step is taken without another evaluation. From where a
    step leaves the bounds or does not lower the cost, `trust_region` goes on.
    """
    x, low, high = np.log(start), *np.log(problem.bounds)
    evaluations = 0
    if objective.loss is None:
        residuals, jacobian = objective(start)
        evaluations = 1
        while evaluations < max_evaluations:
            step = np.linalg.lstsq(jacobian, -residuals, rcond=None)[0]
            cost, gain = float(residuals @ residuals), float(-residuals @ jacobian @ step)
            trial = x + step
            if not ((low < trial) & (trial < high)).all():
                break
            if gain <= tolerance * cost:
                message = "The next step would lower the cost by less than the tolerance"
                return SearchResult(np.exp(trial), cost - gain, 2, message, evaluations)
            evaluations += 1
            try:
                residuals, jacobian = objective(np.exp(trial))
            except (IdentificationError, np.linalg.LinAlgError):
                break
            if not residuals @ residuals < cost:
                break
            x = trial
    outcome = trust_region(
        problem, objective, np.exp(x), max(max_evaluations - evaluations, 1), tolerance
    )
    return replace(outcome, evaluations=evaluations + outcome.evaluations)
