"""Weighted least squares fits of a model to FRF estimates, from one start or from many."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.cost import Problem, stated
from estimators.frf_estimate import FrfEstimate
from estimators.residuals import find_residual
from estimators.weights import optimal_weights
from robotmodels.arrays import Array, ComplexArray, read_only
from robotmodels.errors import IdentificationError, InvalidInput
from robotmodels.parameters import Parameters
from robotmodels.response import Elastic, frequency_response

START_FAILED = -1


@dataclass(frozen=True, eq=False)
class Fit:
    """The end of one search, converged or not.

    Attributes
    ----------
    model, estimate : what was fitted to what.
    residual : "nls", "lls" or "lls_magnitude".
    weights : Lambda^-1, (Q, F, m, n) or (Q, F, m n, m n).
    parameters : fitted values; the start's where the search could not begin.
    cost : V of [WM] (4b) or (7b); infinite where the search could not begin.
    start : (p,) values.
    bounds : (2, p) values.
    status : of `scipy.optimize.least_squares` (1 to 4 converged, 0 out of evaluations), or -1
        where the model has no FRF at the start.
    message : the reason in words.
    evaluations : of the FRF and its sensitivities.
    """

    model: Elastic
    estimate: FrfEstimate
    residual: str
    weights: Array | ComplexArray
    parameters: Parameters
    cost: float
    start: Array
    bounds: Array
    status: int
    message: str
    evaluations: int

    @property
    def converged(self) -> bool:
        """Whether a local minimum was reached."""
        return self.status > 0

    def __str__(self) -> str:
        p = self.parameters
        width = max(len(name) for name in p.names)
        lines = [
            f"{self.residual} fit: {'converged' if self.converged else 'NOT converged'}, "
            f"cost {self.cost:.6g}, {self.evaluations} evaluations ({self.message})"
        ]
        for name, value, unit, start in zip(p.names, p.values, p.units, self.start, strict=True):
            lines.append(f"  {name:<{width}}  {value:12.6g} {unit:<10} start x {value / start:.4g}")
        return "\n".join(lines)


class _Search:
    """Residuals and Jacobian about a start; the last point is kept, so one evaluation serves both.

    A trial step at which the robot has no equilibrium counts as infinitely bad, which makes the
    trust region shrink.
    """

    def __init__(self, problem: Problem, reference: Array) -> None:
        self.problem = problem
        self.reference = reference
        self.evaluations = 0
        self._x: Array | None = None
        self._last: tuple[Array, Array] | None = None

    def at(self, x: Array) -> tuple[Array, Array]:
        if self._last is None or self._x is None or not np.array_equal(x, self._x):
            self.evaluations += 1
            self._last = self.problem.evaluate(self.reference * np.exp(x))
            self._x = x.copy()
        return self._last

    def residuals(self, x: Array) -> Array:
        try:
            values = self.at(x)[0]
        except (IdentificationError, np.linalg.LinAlgError):
            if self._last is None:
                raise
            return np.full(len(self._last[0]), np.inf)
        return values

    def jacobian(self, x: Array) -> Array:
        return self.at(x)[1]


def fit(
    model: Elastic,
    estimate: FrfEstimate,
    residual: str = "lls",
    weights: str | NDArray[Any] = "user",
    start: Array | None = None,
    bounds: tuple[float, float] = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
) -> Fit:
    """Return the fit found from one start: a local minimum, if it converged.

    Parameters
    ----------
    model : robot, or anything with its ``parameters`` and ``network``.
    estimate : FRFs to fit.
    residual : "nls" [WM] (4), "lls" [WM] (7) or "lls_magnitude".
    weights : "user", "optimal", or an array, see `estimators.weights`.
    start : (p,) parameter values; the model's own where None.
    bounds : factors of the model's own values between which parameters are sought.
    max_evaluations : of the FRFs and their sensitivities, after which the search gives up.
    tolerance : relative change of cost and of ln theta, and gradient, at which the search ends.

    Raises
    ------
    InvalidInput : for unknown names, misfitting arrays, a start outside the bounds, fewer data
        than parameters, or a logarithm of zero.
    IdentificationError : if the model has no FRF at the start.
    """
    problem = stated(model, estimate, residual, weights, bounds)
    return _search(problem, problem.checked_start(start), max_evaluations, tolerance)


def multistart(
    model: Elastic,
    estimate: FrfEstimate,
    starts: Array | Sequence[Array],
    residual: str = "lls",
    weights: str | NDArray[Any] = "user",
    bounds: tuple[float, float] = (1e-3, 1e3),
    max_evaluations: int = 200,
    tolerance: float = 1e-10,
    executor: Executor | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Fit, ...]:
    """Return the fits from all `starts` (N, p), the least cost first.

    A start at which the model has no FRF gives a fit that is not converged, of infinite cost and
    with the reason as its message. Other arguments as in `fit`.

    Parameters
    ----------
    executor : runs the searches; in sequence where None.
    progress : called with the number of finished searches and their total.
    """
    problem = stated(model, estimate, residual, weights, bounds)
    points = [problem.checked_start(np.asarray(start, dtype=float)) for start in starts]
    if not points:
        raise InvalidInput("multistart: no starts were given")
    one = partial(_search_or_reason, problem, max_evaluations=max_evaluations, tolerance=tolerance)
    fits = []
    for found in map(one, points) if executor is None else executor.map(one, points):
        fits.append(found)
        if progress is not None:
            progress(len(fits), len(points))
    return tuple(sorted(fits, key=lambda found: found.cost))


def reweighted(found: Fit, rounds: int = 2, tolerance: float = 1e-10) -> Fit:
    """Return the fit repeated with optimal weights evaluated at its own FRF, not the measured.

    [WM] (8) with the measured FRF correlates weights with errors. Over tens of thousands of noisy
    elements that bias outgrows the standard deviations; at the FRF of a good fit it vanishes, and
    no element need be left out. Costs of fits weighted by their own models do not compare: find
    the best of many starts first.
    """
    for _ in range(rounds):
        model, estimate, values = found.model, found.estimate, found.parameters.values
        G = np.asarray(frequency_response(model, estimate.positions, estimate.omega, values))
        problem = Problem(
            model=model,
            estimate=estimate,
            kind=find_residual(found.residual),
            weights=optimal_weights(estimate, found.residual, G),
            bounds=found.bounds,
        )
        found = _search(problem, values, 200, tolerance)
    return found


def perturbed_starts(
    parameters: Parameters, n: int, decades: float, rng: np.random.Generator
) -> Array:
    """Return (n, p) values multiplied by 10^U(-decades, decades), [WM] section 6."""
    if n < 1 or not (np.isfinite(decades) and decades >= 0):
        raise InvalidInput(f"perturbed_starts: n = {n}, decades = {decades}; at least 1 and 0")
    exponents = rng.uniform(-decades, decades, (n, len(parameters)))
    return np.asarray(parameters.values * 10.0**exponents)


def _search(problem: Problem, start: Array, max_evaluations: int, tolerance: float) -> Fit:
    from scipy.optimize import least_squares

    # About the start x = 0, so the first trust region is one e-fold whatever the units.
    search = _Search(problem, start)
    found = least_squares(
        search.residuals,
        np.zeros_like(start),
        jac=search.jacobian,
        bounds=tuple(np.log(problem.bounds / start)),
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=max_evaluations,
    )
    names = problem.model.parameters.names
    stuck = [name for name, side in zip(names, found.active_mask, strict=True) if side]
    message = str(found.message).rstrip(".") + (
        f"; at a bound: {', '.join(stuck)}" if stuck else ""
    )
    values = np.clip(start * np.exp(found.x), *problem.bounds)
    return _fit(problem, start, values, 2 * float(found.cost), int(found.status), message, search)


def _search_or_reason(
    problem: Problem, start: Array, max_evaluations: int, tolerance: float
) -> Fit:
    try:
        return _search(problem, start, max_evaluations, tolerance)
    except (IdentificationError, np.linalg.LinAlgError) as error:
        return _fit(problem, start, start, np.inf, START_FAILED, f"no FRF at the start: {error}")


def _fit(
    problem: Problem,
    start: Array,
    values: Array,
    cost: float,
    status: int,
    message: str,
    search: _Search | None = None,
) -> Fit:
    own = problem.model.parameters
    return Fit(
        model=problem.model,
        estimate=problem.estimate,
        residual=problem.kind.name,
        weights=problem.weights,
        parameters=Parameters(own.names, values, own.units),
        cost=cost,
        start=read_only(start),
        bounds=problem.bounds,
        status=status,
        message=message,
        evaluations=search.evaluations if search is not None else 1,
    )
