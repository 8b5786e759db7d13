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

_CONVERGED = "The next step would lower the cost by less than the tolerance"


def gauss_newton(
    problem: Bounded,
    objective: Objective,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    curvature: Curvature | None = None,
) -> SearchResult:
    """Minimise by full Gauss-Newton steps about ln theta; see `Minimiser`.

    From where a step leaves the bounds or does not lower the cost, `trust_region` goes on.
    """
    before = SearchResult(start, np.inf, 0, "", 0)
    if objective.loss is None:
        before = _full_steps(problem, objective, start, max_evaluations, tolerance)
    if before.status:
        return before
    remaining = max(max_evaluations - before.evaluations, 1)
    after = trust_region(problem, objective, before.values, remaining, tolerance)
    return replace(after, evaluations=before.evaluations + after.evaluations)


def _full_steps(
    problem: Bounded, objective: Objective, start: Array, max_evaluations: int, tolerance: float
) -> SearchResult:
    """Return where full steps lead, with status zero if that is no minimum.

    They end where the next one would lower the cost by less than `tolerance` of it, by the linear
    model of the residuals; that step is taken without another evaluation.
    """
    low, high = problem.bounds
    values, cost, trial = start, np.inf, start
    for evaluations in range(1, max_evaluations + 1):
        try:
            residuals, jacobian = objective(trial)
        except (IdentificationError, np.linalg.LinAlgError):
            break
        if not residuals @ residuals < cost:
            break
        values, cost = trial, float(residuals @ residuals)
        step = np.linalg.lstsq(jacobian, -residuals, rcond=None)[0]
        trial, gain = values * np.exp(step), float(-residuals @ jacobian @ step)
        if not ((low < trial) & (trial < high)).all():
            break
        if gain <= tolerance * cost:
            return SearchResult(trial, cost - gain, 2, _CONVERGED, evaluations)
    return SearchResult(values, cost, 0, "", evaluations)
