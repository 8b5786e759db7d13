"""A search by gradients alone, as [WM]'s: MATLAB's fminunc is BFGS too."""

import numpy as np

from estimators.fitting.trust_region import Bounded, Curvature, Objective, SearchResult
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationError

# Cost, over that at the start, of a trial point at which the robot has no equilibrium: a number,
# not infinity, since the line search interpolates.
_NO_MODEL = 10.0


class _OutOfEvaluationsError(Exception):
    """The limit of evaluations is reached."""


class _Point:
    """Cost and gradient by x = ln(theta/start); remembers the best point.

    Beyond a bound the cost is that at the bound: the search has no bounds of its own.
    """

    def __init__(self, problem: Bounded, objective: Objective, start: Array, limit: int) -> None:
        self.objective, self.start, self.limit = objective, start, limit
        self.low, self.high = np.log(problem.bounds / start)
        self.evaluations, self.first, self.least = 0, np.nan, np.inf
        self.best = np.zeros_like(start)

    def __call__(self, x: Array) -> tuple[float, Array]:
        if self.evaluations >= self.limit:
            raise _OutOfEvaluationsError
        self.evaluations += 1
        inside = np.clip(x, self.low, self.high)
        try:
            cost, gradient = self.objective.gradient(self.start * np.exp(inside))
        except (IdentificationError, np.linalg.LinAlgError):
            if self.evaluations == 1:
                raise
            return _NO_MODEL * self.first, np.zeros_like(x)
        if self.evaluations == 1:
            self.first = cost
        if cost < self.least:
            self.least, self.best = cost, inside
        return cost, np.where(x == inside, gradient, 0.0)


def quasi_newton(
    problem: Bounded,
    objective: Objective,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    curvature: Curvature | None = None,
) -> SearchResult:
    """Minimise by BFGS from `start` (p,), inside the problem's bounds; see `Minimiser`.

    It ends where no slope exceeds `tolerance` times 1 + the largest at the first start, as fminunc
    does, or where rounding hides the way down.
    """
    from scipy.optimize import minimize

    point = _Point(problem, objective, start, max(max_evaluations, 1))
    x = np.zeros_like(start)
    gradient = point(x)[1]
    steepest = float(np.abs(gradient).max()) if curvature is None else curvature.first_slope
    inverse = None if curvature is None else curvature.inverse_hessian
    status, message = 0, "The maximum number of function evaluations is exceeded"
    try:
        solution = minimize(
            point,
            x,
            jac=True,
            method="BFGS",
            options={"gtol": tolerance * (1 + steepest), "hess_inv0": inverse},
        )
    except _OutOfEvaluationsError:
        pass
    else:
        inverse = (solution.hess_inv + solution.hess_inv.T) / 2
        status = 1 if solution.success else 2
        message = str(solution.message)
    values = np.clip(start * np.exp(point.best), *problem.bounds)
    learnt = None if inverse is None else Curvature(inverse, steepest)
    return SearchResult(values, point.least, status, message, point.evaluations, learnt)
