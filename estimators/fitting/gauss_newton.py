"""Gauss-Newton steps from normal equations: damped, or full ones for starts near a minimum."""

from contextlib import suppress

import numpy as np

from estimators.fitting.trust_region import (
    OUT_OF_EVALUATIONS,
    Bounded,
    Curvature,
    Objective,
    Residuals,
    SearchResult,
    at_bounds,
    trust_region,
)
from robotmodels.common.arrays import Array, BoolArray
from robotmodels.common.errors import IdentificationError
from robotmodels.common.symmetric_matrices import unit_diagonal_scaling
from robotmodels.linear.normal_equations import NormalEquations

# Share of each slope that damps steps of its parameter. From 0.3 to 0.8, searches from far starts
# find the best minimum as often; a damping that ends at zero misses it more often.
DAMPING = 0.5
# A step that lowers the cost by less than this share of what it should is followed by shorter
# ones, one that lowers it by more than that by longer ones.
_POOR, _GOOD = 0.25, 0.75
# Least square of a Cholesky pivot, at a unit diagonal, at which all directions are seen.
_REGULAR = 1e-8
_CONVERGED = "The next step would lower the cost by less than the tolerance"


def damped_gauss_newton(
    problem: Bounded,
    objective: Objective,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    curvature: Curvature | None = None,
) -> SearchResult:
    """Minimise by damped Gauss-Newton steps about ln theta; see `Minimiser`.

    Of residuals, which may be robust or ill conditioned, by `trust_region`.
    """
    if isinstance(objective, Residuals):
        return trust_region(problem, objective, start, max_evaluations, tolerance)
    return _minimum(problem, objective, start, max_evaluations, tolerance, DAMPING)


def gauss_newton(
    problem: Bounded,
    objective: Objective,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    curvature: Curvature | None = None,
) -> SearchResult:
    """Minimise by full Gauss-Newton steps about ln theta, damped from where one fails."""
    if isinstance(objective, Residuals) and objective.loss is not None:
        return trust_region(problem, objective, start, max_evaluations, tolerance)
    return _minimum(problem, objective, start, max_evaluations, tolerance, 0.0)


def _minimum(
    problem: Bounded,
    objective: Objective,
    start: Array,
    max_evaluations: int,
    tolerance: float,
    least: float,
) -> SearchResult:
    """Return where steps lead whose damping is never below `least`.

    They end where the next one would lower the cost by less than `tolerance` of it, by the
    quadratic model; that step is taken without another evaluation.
    """
    point = _Point(problem, objective, start, least)
    for evaluations in range(1, max_evaluations + 1):
        step = point.step()
        converged = -predicted_change(point.normal, step) <= tolerance * point.normal.cost
        if converged or evaluations == max_evaluations:
            break
        point.move(step)
    x, cost, status, message = point.x, point.normal.cost, 0, OUT_OF_EVALUATIONS
    if converged:
        # After a step that failed, the model may have no FRF where the next one leads.
        if point.moved:
            x = point.moved_by(step)
            cost += min(predicted_change(point.normal, x - point.x), 0.0)
        status = 2
        message = _CONVERGED + at_bounds(problem, (x <= point.low) | (x >= point.high))
    values = np.clip(start * np.exp(x), *problem.bounds)
    return SearchResult(values, cost, status, message, evaluations)


class _Point:
    """A point x (p,) = ln(theta/start) of a search, and how steps from there are damped."""

    def __init__(self, problem: Bounded, objective: Objective, start: Array, least: float) -> None:
        self.objective, self.start, self.least = objective, start, least
        self.low, self.high = np.log(problem.bounds / start)
        self.x, self.damping, self.moved = np.zeros_like(start), least, True
        self.normal = objective.normal_equations(start)

    def step(self) -> Array:
        """Return the next step; full ones are damped if they are long."""
        step = self._damped()
        if self.least < DAMPING and np.abs(step).max() > 1 / DAMPING:
            self.least = self.damping = DAMPING
            step = self._damped()
        return step

    def _damped(self) -> Array:
        """Return a damped step; parameters at bounds stay if slope or step lead further out.

        Those that the step leads out are held one after the other: a slope that leads inside
        prevails at last, so that the step vanishes at a minimum within the bounds alone.
        """
        free = ~self._leads_out(-self.normal.gradient)
        while True:
            step = damped_step(self.normal, self.damping, free)
            out = self._leads_out(step)
            if not out.any():
                return step
            free[np.argmax(out * np.abs(step))] = False

    def _leads_out(self, step: Array) -> BoolArray:
        return np.asarray((self.x <= self.low) & (step < 0) | (self.x >= self.high) & (step > 0))

    def moved_by(self, step: Array) -> Array:
        """Return the point moved along a step until it is done or the first bound is reached."""
        end = np.where(step > 0, self.high, self.low)
        room = np.full(len(step), np.inf)
        np.divide(end - self.x, step, out=room, where=step != 0)
        share = min(1.0, float(room.min()))
        return np.where(room <= share, end, self.x + share * step)

    def move(self, step: Array) -> None:
        """Move by a step if that lowers the cost, and judge it."""
        trial, lowered = self.moved_by(step), -np.inf
        gain = -predicted_change(self.normal, trial - self.x)
        with suppress(IdentificationError, np.linalg.LinAlgError):
            there = self.objective.normal_equations(self.start * np.exp(trial))
            lowered = self.normal.cost - there.cost
        poor, full = lowered < _POOR * gain, self.least < DAMPING
        # A full step that does badly is not taken: they are for starts near a minimum.
        self.moved = lowered > 0 and not (poor and full)
        if poor:
            self.least = max(self.least, DAMPING)
            self.damping = max(4 * self.damping, self.least)
        elif lowered > _GOOD * gain:
            self.damping = max(self.damping / 2, self.least)
        if self.moved:
            self.x, self.normal = trial, there


def predicted_change(normal: NormalEquations, step: Array) -> float:
    """Return the change of the cost by a step of ln theta (p,), by the quadratic model."""
    return float(normal.gradient @ step + step @ normal.hessian @ step / 2)


def damped_step(normal: NormalEquations, damping: float, free: BoolArray) -> Array:
    """Return the step of ln theta (p,) of the `free` parameters, zero in directions not seen.

    `damping` times the magnitude of each slope is added to its diagonal entry: far away, where
    slopes prevail, no parameter by itself would move by more than 1/damping, and near a minimum,
    where they vanish, steps become full ones. That damping by slopes keeps Gauss-Newton's
    convergence quadratic is what Fan and Yuan (2005) show of a common one.
    """
    gradient = np.where(free, normal.gradient, 0.0)
    matrix = normal.hessian + np.diag(damping * np.abs(gradient))
    matrix = np.where(free[:, None] & free, matrix, 0.0)
    s = unit_diagonal_scaling(matrix)
    scaled, slope = s[:, None] * matrix * s, s * gradient
    with suppress(np.linalg.LinAlgError):
        if np.diagonal(np.linalg.cholesky(scaled)).min() ** 2 > _REGULAR:
            return np.asarray(-s * np.linalg.solve(scaled, slope))
    values, vectors = np.linalg.eigh(scaled)
    seen = values > len(values) * np.finfo(float).eps * values[-1]
    along = np.where(seen, vectors.T @ slope / np.where(seen, values, 1.0), 0.0)
    return np.asarray(-s * (vectors @ along))
