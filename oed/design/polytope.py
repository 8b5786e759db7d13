"""The weights that are allowed, and the most a linear function of them can reach.

Every set of weights here is { w : R w <= b, lower <= w <= upper } with a first row that is positive
everywhere, the budget, so that it is bounded.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, SolverFailed

# How much wider bounds are made, of a row's scale, where rows leave no room together.
_WIDENED = 2e-8


@dataclass(frozen=True, eq=False)
class Polytope:
    """Allowed weights of Q candidates.

    Attributes
    ----------
    rows, bounds : ndarray, (m, Q)
        (m,); the first row is the budget, positive everywhere.
    lower, upper : ndarray, (Q,)
        Not negative; upper may be infinite.
    names : tuple of str
        Names of the rows, for messages and multipliers.
    """

    rows: Array
    bounds: Array
    lower: Array
    upper: Array
    names: tuple[str, ...]

    @classmethod
    def shares(cls, n_candidates: int) -> "Polytope":
        """Return weights that sum to one."""
        zero, free = np.zeros(n_candidates), np.full(n_candidates, np.inf)
        return cls(np.ones((1, n_candidates)), np.ones(1), zero, free, ("experiments",))

    @property
    def slack(self) -> Array:
        """Slack of the rows at the lower weights, (m,)."""
        return np.asarray(self.bounds - self.rows @ self.lower)

    def violation(self, weights: Array) -> float:
        """Return the largest violation of a row or limit, relative to its bound.

        Relative to what all weights would use where that is zero, so that rounding is small there.
        """
        total = float(weights.sum()) or 1.0
        used = np.abs(self.rows).max(axis=1) * total
        sizes = np.where(self.bounds != 0, np.abs(self.bounds), np.where(used > 0, used, 1.0))
        over = (self.rows @ weights - self.bounds) / sizes
        limited = np.isfinite(self.upper)
        upper = self.upper[limited]
        above = (weights[limited] - upper) / np.where(upper > 0, upper, total)
        below = (self.lower - weights) / np.maximum(self.lower, weights.max(initial=1e-12))
        return float(max(over.max(), above.max(initial=0.0), below.max()))

    def upper_bound(self, coefficients: Array, multipliers: Array | None = None) -> float:
        """Return an upper bound on c'w over all allowed w; the largest itself if m = 1.

        Any multipliers y >= 0 (m,) of the rows give one, (c - R'y)'w + b'y, to be maximised
        over the budget and the limits alone, a fractional knapsack solved by sorting. The best ones
        make it the largest; a linear program computes them if None.
        """
        if len(self.rows) == 1:
            return self._knapsack(coefficients)
        if multipliers is None:
            multipliers = self.best_extreme_point(coefficients)[1]
        y = np.maximum(multipliers[1:], 0.0)
        return self._knapsack(coefficients - y @ self.rows[1:]) + float(y @ self.bounds[1:])

    def best_extreme_point(self, coefficients: Array) -> tuple[Array, Array]:
        """Return weights (Q,) that maximise c'w, and the rows' multipliers (m,).

        Raises
        ------
        InvalidInput
            If no weights are allowed.
        SolverFailed
            If HiGHS gives no answer for another reason.
        """
        if len(self.rows) == 1:
            return self._fill(coefficients), np.zeros(1)
        scale = np.abs(coefficients).max() or 1.0
        try:
            solution = _linear_program(
                -coefficients / scale, self.rows, self.bounds, self._intervals
            )
        except InvalidInput:
            raise InvalidInput(f"constraints: no design satisfies {self.conflict()}") from None
        return np.asarray(solution.x), np.asarray(-scale * solution.ineqlin.marginals)

    def interior(self, units: Array) -> tuple[Array, Array]:
        """Return bounds beyond the lower weights, (m,), and shares (Q,) with room in every row.

        Where rows leave no room together, as a pair that makes an equation, the bounds are a little
        wider than allowed. Shares are weights over `units`.
        """
        bounds = self.slack
        if len(self.rows) == 1:
            return bounds, np.zeros(len(units))
        rows = self.rows * units
        scales = np.maximum(np.abs(rows).max(axis=1), np.abs(bounds))
        scales = np.where(scales > 0, scales, 1.0)
        caps = (self.upper - self.lower) / units
        table = np.column_stack([rows / scales[:, None], np.ones(len(rows))])
        limits = [*((0.0, cap) for cap in caps.tolist()), (None, 1.0)]
        goal = np.append(np.zeros(len(units)), -1.0)
        for _ in range(len(rows) + 1):
            solution = _linear_program(goal, table, bounds / scales, limits)
            if solution.x[-1] >= 0.5 * _WIDENED:
                break
            # The rows that together leave none are those of positive multipliers.
            bounds = bounds + np.where(solution.ineqlin.marginals < -1e-9, _WIDENED * scales, 0.0)
        return bounds, np.asarray(solution.x[:-1])

    def conflict(self) -> str:
        """Return the names of rows that together with the limits allow no weights.

        Rows are removed one by one as long as the others still conflict.
        """
        conflicting = list(range(len(self.rows)))
        for row in reversed(range(len(self.rows))):
            fewer = [r for r in conflicting if r != row]
            if fewer and not self._feasible(fewer):
                conflicting = fewer
        return " together with ".join(self.names[r] for r in conflicting)

    def _feasible(self, rows: list[int]) -> bool:
        zero = np.zeros(len(self.lower))
        try:
            _linear_program(zero, self.rows[rows], self.bounds[rows], self._intervals)
        except InvalidInput:
            return False
        return True

    @property
    def _intervals(self) -> list[tuple[float, float]]:
        return list(zip(self.lower.tolist(), self.upper.tolist(), strict=True))

    def _knapsack(self, coefficients: Array) -> float:
        free = np.isinf(self.upper)
        if free.all():
            # All of the budget goes to the largest coefficient per cost.
            ratio = float((coefficients / self.rows[0]).max())
            slack = float(self.bounds[0] - self.rows[0] @ self.lower)
            return float(coefficients @ self.lower) + slack * max(ratio, 0.0)
        return float(coefficients @ self._fill(coefficients))

    def _fill(self, coefficients: Array) -> Array:
        """Return the weights that maximise c'w by the budget and the limits alone."""
        cost = self.rows[0]
        weights = self.lower.copy()
        slack = float(self.bounds[0] - cost @ self.lower)
        if np.isinf(self.upper).all():
            index = int(np.argmax(coefficients / cost))
            if coefficients[index] > 0:
                weights[index] += slack / cost[index]
            return weights
        order = np.argsort(-coefficients / cost, kind="stable")
        order = order[coefficients[order] > 0]
        demand = cost[order] * (self.upper - self.lower)[order]
        before = np.concatenate([[0.0], np.cumsum(demand)[:-1]]) if len(order) else demand
        weights[order] += np.minimum(demand, np.maximum(slack - before, 0.0)) / cost[order]
        return weights


def _linear_program(
    goal: Array, rows: Array, bounds: Array, limits: Sequence[tuple[float | None, float]]
) -> Any:
    """Return what scipy says of the least goal'x with rows x <= bounds, within the limits.

    Raises
    ------
    InvalidInput
        If there is no such x.
    SolverFailed
        If HiGHS gives no answer for another reason.
    """
    from scipy.optimize import linprog

    options = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    answer = linprog(goal, A_ub=rows, b_ub=bounds, bounds=limits, options=options)
    if answer.status == 2:
        raise InvalidInput("constraints: no design satisfies them")
    if answer.x is None:
        raise SolverFailed(f"constraints: HiGHS ended without an answer: {answer.message}")
    return answer
