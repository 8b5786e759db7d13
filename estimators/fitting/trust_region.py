"""Searches about ln theta: what is minimised, and Gauss-Newton in a trust region, by scipy."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from robotmodels.common.arrays import Array, BoolArray
from robotmodels.common.errors import IdentificationError
from robotmodels.linear.normal_equations import NormalEquations
from robotmodels.linear.response import Elastic

START_FAILED = -1
STOPPED = -2
OUT_OF_EVALUATIONS = "The maximum number of function evaluations is exceeded"


Loss = Callable[[Array], Array]


class Curvature(NamedTuple):
    """What a quasi-Newton search has learnt: inverse Hessian (p, p), largest slope at its start."""

    inverse_hessian: Array
    first_slope: float


@dataclass(frozen=True, eq=False)
class SearchResult:
    """What a search came to: values (p,), cost, and status, message, evaluations as in `Fit`.

    A search that goes on from there may begin with the `curvature`, if there is one.
    """

    values: Array
    cost: float
    status: int
    message: str
    evaluations: int
    curvature: Curvature | None = None


class Bounded(Protocol):
    """What a search knows of its problem: the model, for names, and bounds (2, p)."""

    @property
    def model(self) -> Elastic:
        """Model that is fitted."""

    @property
    def bounds(self) -> Array:
        """Lowest and highest values, (2, p)."""


class Objective(Protocol):
    """A cost with its gradient, or with Gauss-Newton's matrix too."""

    def normal_equations(self, values: Array) -> NormalEquations:
        """Return the cost at `values` (p,), its gradient by ln theta and Gauss-Newton's matrix."""

    def gradient(self, values: Array) -> tuple[float, Array]:
        """Return the cost and its gradient by ln theta (p,) at `values` (p,)."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """The objective that a function of residuals and Jacobian makes.

    Its normal equations are those of the squares, without a loss.
    """

    evaluate: Callable[[Array], tuple[Array, Array]]
    loss: Loss | None = None

    def __call__(self, values: Array) -> tuple[Array, Array]:
        """Return residuals (r,) and their Jacobian by ln theta (r, p) at `values` (p,)."""
        return self.evaluate(values)

    def normal_equations(self, values: Array) -> NormalEquations:
        """Return the cost at `values` (p,), its gradient by ln theta and Gauss-Newton's matrix."""
        r, J = self.evaluate(values)
        return NormalEquations(float(r @ r), 2 * J.T @ r, 2 * J.T @ J)

    def gradient(self, values: Array) -> tuple[float, Array]:
        """Return the cost and its gradient by ln theta (p,) at `values` (p,)."""
        residuals, jacobian = self.evaluate(values)
        squares = residuals**2
        if self.loss is None:
            return float(squares.sum()), 2 * jacobian.T @ residuals
        losses, slopes = self.loss(squares)[:2]
        return float(losses.sum()), 2 * jacobian.T @ (slopes * residuals)


class Minimiser(Protocol):
    """A way to minimise an objective inside the problem's bounds."""

    def __call__(
        self,
        problem: Bounded,
        objective: Objective,
        start: Array,
        max_evaluations: int,
        tolerance: float,
        curvature: Curvature | None = None,
    ) -> SearchResult:
        """Return the minimum from `start` (p,), with the curvature of an earlier search if any."""


class _Point:
    """Residuals and Jacobian about a start; the last point is stored: one evaluation serves both.

    A trial step at which the robot has no equilibrium counts as infinitely bad, which makes the
    trust region shrink. A parameter that nothing depends on would be taken as far as the trust
    region reaches, by rounding: p more residuals, all zero, have a slope that holds it.
    """

    def __init__(self, evaluate: Residuals, reference: Array) -> None:
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
    problem: Bounded,
    objective: Residuals,
    start: Array,
    max_evaluations: int,
    tolerance: float,
) -> SearchResult:
    """Minimise by Gauss-Newton steps in a trust region, inside the problem's bounds."""
    from scipy.optimize import least_squares

    # About the start x = 0, so the first trust region is one e-fold whatever the units.
    point = _Point(objective, start)
    loss_name: Any = "linear" if objective.loss is None else objective.loss
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
        message=str(solution.message).rstrip(".") + at_bounds(problem, solution.active_mask != 0),
        evaluations=point.evaluations,
    )


def at_bounds(problem: Bounded, there: BoolArray) -> str:
    """Return the end of a message: which parameters (p,) are at a bound, if any."""
    stuck = [name for name, so in zip(problem.model.parameters.names, there, strict=True) if so]
    return f"; at a bound: {', '.join(stuck)}" if stuck else ""
