"""Searches about ln theta by scipy: Gauss-Newton in a trust region, or quasi-Newton."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from estimators.fitting.fit_problem import Problem
from robotmodels.common.arrays import Array
from robotmodels.common.errors import IdentificationError

START_FAILED = -1
STOPPED = -2


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search came to: values (p,), cost, and status, message, evaluations as in `Fit`."""

    values: Array
    cost: float
    status: int
    message: str
    evaluations: int


class Minimiser(Protocol):
    """A way to minimise the squares of residuals; see `trust_region` for the arguments."""

    def __call__(
        self,
        problem: Problem,
        evaluate: Callable[[Array], tuple[Array, Array]],
        start: Array,
        max_evaluations: int,
        tolerance: float,
        loss: Callable[[Array], Array] | None = None,
    ) -> SearchResult:
        """Return the minimum from `start` (p,)."""
        ...


class _Point:
    """Residuals and Jacobian about a start; the last point is stored: one evaluation serves both.

    A trial step at which the robot has no equilibrium counts as infinitely bad, which makes the
    trust region shrink. A parameter that nothing depends on would be taken as far as the trust
    region reaches, by rounding: p more residuals, all zero, have a slope that holds it.
    """

    def __init__(self, evaluate: Callable[[Array], tuple[Array, Array]], reference: Array) -> None:
        self.evaluate = evaluate
        self.reference = reference
        self.evaluations = 0
        self._x: Array | None = None
        self._last: tuple[Array, Array] | None = None

    def at(self, x: Array) -> tuple[Array, Array]:
        if self._last is None or self._x is None or not np.array_equal(x, self._x):
            self.evaluations += 1
            self._last = self.evaluate(self.reference * np.exp(x))
            self._x = x.copy()
        return self._last

    def residuals(self, x: Array) -> Array:
        try:
            values = self.at(x)[0]
        except (IdentificationError, np.linalg.LinAlgError):
            if self._last is None:
                raise
            values = np.full(len(self._last[0]), np.inf)
        return np.append(values, np.zeros_like(x))

    def jacobian(self, x: Array) -> Array:
        slopes = self.at(x)[1]
        return np.vstack([slopes, np.diag(~slopes.any(axis=0) * np.abs(slopes).max())])


def trust_region(
    problem: Problem,
    evaluate: Callable[[Array], tuple[Array, Array]],
    start: Array,
    max_evaluations: int,
    tolerance: float,
    loss: Callable[[Array], Array] | None = None,
) -> SearchResult:
    """Minimise the squares that `evaluate` gives, inside the problem's bounds, from `start` (p,).

    Parameters
    ----------
    evaluate : callable
        Residuals (r,) and their Jacobian by ln theta (r, p) at values (p,).
    loss : callable, optional
        Loss of squared residuals, with its derivatives; none where None.
    """
    from scipy.optimize import least_squares

    # About the start x = 0, so the first trust region is one e-fold whatever the units.
    point = _Point(evaluate, start)
    loss_name: Any = "linear" if loss is None else loss
    solution = least_squares(
        point.residuals,
        np.zeros_like(start),
        jac=point.jacobian,
        bounds=tuple(np.log(problem.bounds / start)),
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=max_evaluations,
        loss=loss_name,
    )
    values = np.clip(start * np.exp(solution.x), *problem.bounds)
    return SearchResult(
        values=values,
        cost=2 * float(solution.cost),
        status=int(solution.status),
        message=_message(problem, solution),
        evaluations=point.evaluations,
    )


def exact_search(
    problem: Problem,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    minimise: Minimiser = trust_region,
) -> SearchResult:
    """Search with exact residuals and derivatives, equilibria computed anew at every point."""
    loss = None if problem.loss == "linear" else problem.robust
    return minimise(problem, problem.evaluate, start, max_evaluations, tolerance, loss)


def quasi_newton(
    problem: Problem,
    evaluate: Callable[[Array], tuple[Array, Array]],
    start: Array,
    max_evaluations: int,
    tolerance: float,
    loss: Callable[[Array], Array] | None = None,
) -> SearchResult:
    """Minimise as `trust_region` does, by L-BFGS-B: from gradients alone, as [WM]'s fminunc does.

    As many updates of the Hessian as there are parameters are stored, and none from before the
    search. Arguments as in `trust_region`; the gradient's tolerance is relative to 1 + that at the
    start, as fminunc's is.
    """
    from scipy.optimize import minimize

    point = _Point(evaluate, start)

    def cost_and_gradient(x: Array) -> tuple[float, Array]:
        try:
            residuals, jacobian = point.at(x)
        except (IdentificationError, np.linalg.LinAlgError):
            if point.evaluations == 1:
                raise
            # A number, not infinity: the line search interpolates.
            return _NO_MODEL * worst, np.zeros_like(x)
        squares = residuals**2
        if loss is None:
            return float(squares.sum()), 2 * jacobian.T @ residuals
        losses, slopes = loss(squares)[:2]
        return float(losses.sum()), 2 * jacobian.T @ (slopes * residuals)

    worst, gradient = cost_and_gradient(np.zeros_like(start))
    solution = minimize(
        cost_and_gradient,
        np.zeros_like(start),
        jac=True,
        method="L-BFGS-B",
        bounds=np.log(problem.bounds / start).T,
        options={
            "maxcor": len(start),
            "maxfun": max_evaluations,
            "maxiter": max_evaluations,
            "ftol": tolerance,
            "gtol": tolerance * (1 + float(np.abs(gradient).max())),
        },
    )
    return SearchResult(
        values=np.clip(start * np.exp(solution.x), *problem.bounds),
        cost=float(solution.fun),
        status=int(solution.success),
        message=str(solution.message),
        evaluations=point.evaluations,
    )


# Cost, over that at the start, of a trial point at which the robot has no equilibrium.
_NO_MODEL = 10.0

MINIMISERS: dict[str, Minimiser] = {"trust_region": trust_region, "quasi_newton": quasi_newton}


def _message(problem: Problem, solution: Any) -> str:
    names = problem.model.parameters.names
    stuck = [name for name, side in zip(names, solution.active_mask, strict=True) if side]
    at = f"; at a bound: {', '.join(stuck)}" if stuck else ""
    return str(solution.message).rstrip(".") + at
